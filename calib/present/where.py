"""Where frames are, in every form in which people and controllers tell poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset_import.where import FrameDifference, FramesTold, NamedFrame
from calib.rendering import numbers

_SAME_MM = 0.05  # digits of a pendant
_OWN_CALIBRATION_MM = 30.0  # by which an arm's own calibration moves a place at most


def frames_document(told: FramesTold) -> dict[str, Any]:
    """Keys of the command's `--json`."""
    document: dict[str, Any] = {"frames": [{"frame": one.name} | _forms(one.base_T_frame) for one in told.frames]}
    found = told.difference
    if found is not None:
        whole, off_rad = found.quarter_turn
        document["difference"] = {
            "from": found.one.name, "to": found.other.name, "read_as": [found.one.form, found.other.form],
            "as_told": found.as_told, "shift_mm": found.shift_mm, "distance_mm": float(np.linalg.norm(found.shift_mm)),
            "turn_deg": float(np.degrees(np.linalg.norm(frames.rotvec_from_rotation(found.turn)))),
            **_angles(found.turn),
            "quarter_turn_rpy_deg": _angles(whole)["rpy_deg"], "from_quarter_turn_deg": float(np.degrees(off_rad)),
        }  # fmt: skip
    return document


def _angles(rotation: Array) -> dict[str, list[float]]:
    """The forms of an attitude by angles and numbers."""
    rpy_deg = (np.degrees(frames.rpy_from_rotation(rotation)) + 0.0).tolist()
    return {
        "quaternion_wxyz": frames.quaternion_from_rotation(rotation).tolist(),
        "rotation_vector_deg": np.degrees(frames.rotvec_from_rotation(rotation)).tolist(),
        "rpy_deg": rpy_deg,
        "abc_deg": rpy_deg[::-1],
    }


def _forms(base_T_frame: Array) -> dict[str, Any]:
    place = {"matrix": base_T_frame.tolist(), "xyz_mm": base_T_frame[:3, 3].tolist()}
    return place | _angles(base_T_frame[:3, :3])


def frames_text(told: FramesTold) -> str:
    """The frames, a line each, those that were asked for in every form, and the difference."""
    lines = [f"{one.name}: {_row(one.base_T_frame[:3, 3])} mm" for one in told.frames if one not in told.shown]
    for one in told.shown:
        lines += ["", *_in_full(one)]
    return "\n".join([*lines, *(["", _difference(told.difference)] if told.difference is not None else [])]).lstrip()


def _in_full(one: NamedFrame) -> list[str]:
    forms = _forms(one.base_T_frame)
    return [
        f"{one.name}{f' ({one.form})' if one.form else ''}",
        f"  place                        {_row(forms['xyz_mm'])} mm",
        *(f"  {'matrix' if not k else '':28} {_row(row, 6)}" for k, row in enumerate(forms["matrix"])),
        f"  quaternion w, x, y, z        {_row(forms['quaternion_wxyz'], 6)}",
        f"  rotation vector              {_row(forms['rotation_vector_deg'])} deg",
        f"  roll, pitch, yaw; W P R      {_row(forms['rpy_deg'])} deg",
        f"  A B C of KUKA                {_row(forms['abc_deg'])} deg",
    ]


def _difference(found: FrameDifference) -> str:
    distance_mm = float(np.linalg.norm(found.shift_mm))
    turned = float(np.degrees(np.linalg.norm(frames.rotvec_from_rotation(found.turn))))
    whole, off_rad = found.quarter_turn
    text = f"{found.other.name} is {numbers.length(distance_mm)} from {found.one.name} ({_row(found.shift_mm)} mm)"
    if found.is_quarter_turn:
        read = "" if found.as_told else f", if read as {found.one.form}, and {found.other.form}"
        turn = _row(_angles(whole)["rpy_deg"], 0)
        off = f"{np.degrees(off_rad):.2g} deg"
        text += f" and turned by the fixed turn ({turn}) deg, roll, pitch and yaw, to {off}{read}: "
        text += "one frame" if turned < 1.0 else "one frame with other names of its axes, as ROS's flange and tool0"
    else:
        text += f" and turned by {turned:.3g} deg (roll, pitch, yaw {_row(_angles(found.turn)['rpy_deg'])} deg)"
    if found.is_quarter_turn and _SAME_MM < distance_mm < _OWN_CALIBRATION_MM:
        text += ". Places that differ so at equal joints are of two tables: the arm's own calibration is in one of both"
    return f"{text}."


def _row(values: Any, digits: int = 3) -> str:
    return ", ".join(f"{value + 0.0:.{digits}f}" for value in values)
