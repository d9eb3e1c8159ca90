"""Poses of a marker in the camera's frame that another program wrote.

ROS messages (PoseStamped, TransformStamped; metres, x y z w), samples of easy_handeye and easy_handeye2 (`optical` or
`tracking`), OpenCV's FileStorage and plain JSON or YAML (lists `rvecs` and `tvecs`, or `R_target2cam` and
`t_target2cam`), and tables (x, y, z or tx, ty, tz, with qx, qy, qz, qw or a rotation vector rx, ry, rz in rad).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.camera.documents import SUFFIXES, documents, number_array
from calib.errors import CalibError
from calib.text_files.user_table import UserTable, load_table

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
_SAMPLES = ("optical", "tracking", "camera_T_marker", "camera", "marker", "object", "target")
_ROTATIONS = ("rvecs", "r_target2cam", "rvec")
_SHIFTS = ("tvecs", "t_target2cam", "tvec")


@dataclass(frozen=True)
class MarkerPoses:
    """Poses of a marker in the camera's frame, in the order of the file."""

    camera_T_marker: Array  # (M, 4, 4) mm
    names: tuple[str, ...] | None  # (M,) of the poses of the arm, where the file has them
    note: str


def load_marker_poses(path: Path, unit: str | None = None) -> MarkerPoses:
    """Marker poses of a file; `unit` of lengths where the file does not tell it. Raises CalibError."""
    if path.suffix.lower() not in SUFFIXES:
        return _of_table(path, unit)
    found = documents(path)
    if len(found) == 1 and isinstance(found[0], dict) and isinstance(found[0].get("samples"), list):
        found = found[0]["samples"]
    elif len(found) == 1 and isinstance(found[0], list):
        found = found[0]
    if len(found) == 1 and isinstance(found[0], dict):
        lists = _of_lists(path, found[0], unit)
        if lists is not None:
            return lists
    poses, names = [], []
    for k, one in enumerate(found):
        where = f"{path}: pose {k + 1}"
        part = _pose_part(one)
        if part is None:
            raise CalibError(
                f"{where}: holds no pose of a marker; a PoseStamped, a TransformStamped, a sample with "
                f"{' or '.join(_SAMPLES[:2])}, or lists rvecs and tvecs are read"
            )
        shift = number_array(part.get("position", part.get("translation")))
        turn = number_array(part.get("orientation", part.get("rotation")))
        if shift is None or len(shift) != 3 or turn is None or len(turn) != 4:
            raise CalibError(f"{where}: three lengths and a quaternion x, y, z, w are needed")
        poses.append(_transform(where, turn[[3, 0, 1, 2]], shift * UNITS_MM[unit or "m"]))
        names.append(str(one["pose"]) if isinstance(one.get("pose"), str | int) else "")
    if not poses:
        raise CalibError(f"{path}: holds no pose of a marker")
    named = tuple(names) if all(names) else None
    return MarkerPoses(
        np.stack(poses), named, f"{len(poses)} poses of a marker, lengths in {unit or 'm, as ROS has it'}"
    )


def _pose_part(one: Any) -> dict[str, Any] | None:
    """The part of a message or sample that holds position and orientation of the marker."""
    if not isinstance(one, dict):
        return None
    for key in (*_SAMPLES, "pose", "transform"):
        part = one.get(key)
        if isinstance(part, dict):
            return _pose_part(part) or part
    return one if {"position", "orientation"} <= set(one) or {"translation", "rotation"} <= set(one) else None


def _transform(where: str, quaternion: Array, shift_mm: Array) -> Array:
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-2:
        raise CalibError(f"{where}: a quaternion of length {length:.4g}; a unit quaternion is needed")
    return frames.make_transform(frames.rotation_from_quaternion(quaternion), shift_mm)


def _of_lists(path: Path, document: dict[str, Any], unit: str | None) -> MarkerPoses | None:
    """Poses of a document with lists of rotations and shifts; None where it has none."""
    keys = {str(key).lower(): value for key, value in document.items()}
    turns = next((keys[name] for name in _ROTATIONS if name in keys), None)
    shifts = next((keys[name] for name in _SHIFTS if name in keys), None)
    if turns is None and shifts is None:
        return None
    if turns is None or shifts is None:
        raise CalibError(f"{path}: has one of rvecs and tvecs; both are needed")
    shift = _rows(shifts, (3,))
    turn = _rows(turns, (9, 3))
    if shift is None or turn is None or len(shift) != len(turn):
        raise CalibError(
            f"{path}: as many rvecs (or 3 x 3 matrices) as tvecs are needed, found {_count(turn)} and {_count(shift)}"
        )
    unit = _required(path, unit)
    rotation = turn.reshape(-1, 3, 3) if turn.shape[1] == 9 else frames.rotation_from_rotvec(turn)
    if np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max() > 1e-3:
        raise CalibError(f"{path}: a matrix among the rotations is none")
    return MarkerPoses(frames.make_transform(rotation, shift * UNITS_MM[unit]), None, f"{len(turn)} poses of a marker")


def _count(rows: Array | None) -> str:
    return "none that can be read" if rows is None else str(len(rows))


def _rows(value: Any, widths: tuple[int, ...]) -> Array | None:
    """Numbers (M, width) of a list of vectors or matrices, or of one matrix with a row each."""
    if isinstance(value, list):
        each = [number_array(one) for one in value]
        if each and all(one is not None for one in each):
            lengths = {len(one) for one in each if one is not None}
            if len(lengths) == 1 and lengths <= set(widths):
                return np.array(each, dtype=float)
    flat = number_array(value)
    if flat is None:
        return None
    if isinstance(value, dict) and int(value.get("cols", 0)) in widths:
        return flat.reshape(-1, int(value["cols"]))
    return flat.reshape(-1, widths[-1]) if len(flat) % widths[-1] == 0 else None


def _required(path: Path, unit: str | None) -> str:
    if unit is None:
        raise CalibError(f"{path}: does not tell the unit of its lengths; give --length-unit mm or --length-unit m")
    return unit


def _of_table(path: Path, unit: str | None) -> MarkerPoses:
    """Poses of a table. Raises CalibError."""
    faults: list[str] = []
    table = load_table(path, lambda fault: faults.append(str(fault)), any_encoding=True)
    columns = {name.strip().lower(): name for name in table.columns}
    shift, told = _three(columns, ("x", "y", "z"), ("tx", "ty", "tz"), ("tvec_x", "tvec_y", "tvec_z"))
    if shift is None:
        raise CalibError(f"{path}: line 1: found {', '.join(table.columns)}; columns x, y, z or tx, ty, tz are needed")
    quaternion = [columns.get(name) for name in ("qw", "qx", "qy", "qz")]
    vector, _ = _three(columns, ("rx", "ry", "rz"), ("rvec_x", "rvec_y", "rvec_z"), ("rotx", "roty", "rotz"))
    unit = _required(path, told or unit)
    shift_mm = _numbers(table, shift, faults) * UNITS_MM[unit]
    if all(quaternion):
        values = _numbers(table, [str(name) for name in quaternion], faults)
        if not faults:
            poses = [_transform(f"{path}: line {table.lines[i]}", values[i], shift_mm[i]) for i in range(len(shift_mm))]
    elif vector is not None:
        rotation = frames.rotation_from_rotvec(_numbers(table, vector, faults))
        poses = list(frames.make_transform(rotation, shift_mm))
    else:
        raise CalibError(f"{path}: line 1: a quaternion qx, qy, qz, qw or a rotation vector rx, ry, rz is needed")
    if faults:
        raise CalibError("\n".join(faults))
    if not len(shift_mm):
        raise CalibError(f"{path}: holds no pose of a marker")
    pose = next((columns[name] for name in ("pose", "image", "id", "name") if name in columns), None)
    names = None if pose is None else tuple(table.text(pose))
    return MarkerPoses(np.stack(poses), names, f"{len(poses)} poses of a marker, lengths in {unit}")


def _three(columns: dict[str, str], *choices: tuple[str, str, str]) -> tuple[list[str] | None, str | None]:
    """Names of three columns, perhaps with a unit behind, and that unit."""
    for choice in choices:
        for unit in (None, *UNITS_MM, "rad"):
            names = [columns.get(name if unit is None else f"{name}_{unit}") for name in choice]
            if all(names):
                return [str(name) for name in names], unit if unit in UNITS_MM else None
    return None, None


def _numbers(table: UserTable, names: list[str], faults: list[str]) -> Array:
    return np.column_stack([table.numbers(name, lambda fault: faults.append(str(fault))) for name in names])
