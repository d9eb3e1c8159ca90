"""Poses of a marker in the camera's frame, and of the flange beside them, that another program wrote.

ROS messages (PoseStamped, TransformStamped; metres, x y z w), samples of easy_handeye and easy_handeye2 (`optical` or
`tracking`, and `robot`), of MoveIt's hand-eye calibration (`object_wrt_sensor`, `effector_wrt_world`, matrices in
metres), OpenCV's FileStorage and plain JSON or YAML (lists `rvecs` and `tvecs`, or `R_target2cam` and `t_target2cam`,
`R_gripper2base` and `t_gripper2base`), and tables of a marker's poses (x, y, z or tx, ty, tz, with qx, qy, qz, qw or a
rotation vector rx, ry, rz in rad). Tables of the flange's poses are read by `flange_poses`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset_import.flange_columns import VECTOR, flange_columns
from calib.errors import CalibError
from calib.extras.camera.importing.documents import SUFFIXES, documents, number_array
from calib.text_files.column_names import UNITS, split_unit
from calib.text_files.user_table import UserTable, load_table

EASY_HANDEYE = "robot"  # name of the arm's pose in a sample of easy_handeye
UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


@dataclass(frozen=True)
class _Keys:
    """Names by which files have one kind of poses, in lower case."""

    what: str
    samples: tuple[str, ...]  # of a pose within a sample
    lists: tuple[str, ...]  # of a list of all poses
    rotations: tuple[str, ...]
    shifts: tuple[str, ...]
    inverse: str = "\0"  # in names of rotations and shifts of the inverse poses
    bare: bool = True  # whether a pose that has no name is of this kind


_MARKER = _Keys(
    "a marker",
    ("optical", "tracking", "object_wrt_sensor", "camera_t_marker", "camera", "marker", "object", "target"),
    ("camera_marker_samples", "marker_poses"),
    ("rvecs", "r_target2cam", "rvec"),
    ("tvecs", "t_target2cam", "tvec"),
)
_FLANGE = _Keys(
    "the flange",
    (EASY_HANDEYE, "effector_wrt_world", "base_t_flange", "effector", "gripper", "flange", "hand"),
    ("hand_world_samples", "robot_poses"),
    ("r_gripper2base", "r_base2gripper"),
    ("t_gripper2base", "t_base2gripper"),
    inverse="base2gripper",
)


@dataclass(frozen=True)
class MarkerPoses:
    """Poses of a marker in the camera's frame, or of the flange in the base's, in the order of the file."""

    camera_T_marker: Array  # (M, 4, 4) mm
    names: tuple[str, ...] | None  # (M,) of the poses of the arm, where the file has them
    note: str
    key: str = ""  # name of the poses within the file's samples


def load_marker_poses(path: Path, unit: str | None = None) -> MarkerPoses:
    """Marker poses of a file; `unit` of lengths where the file does not tell it. Raises CalibError."""
    if path.suffix.lower() not in SUFFIXES:
        return _of_table(path, unit)
    found = _of_documents(path, unit, _MARKER)
    if found is None:
        raise CalibError(
            f"{path}: pose 1: holds no pose of a marker; a PoseStamped, a TransformStamped, a sample with "
            f"{' or '.join(_MARKER.samples[:3])}, or lists rvecs and tvecs are read"
        )
    return found


def load_flange_poses(path: Path, unit: str | None = None, *, beside: bool = False) -> MarkerPoses | None:
    """Poses of the flange in the base's frame that a file holds; None where it holds none. Raises CalibError.

    With `beside` they are those of the robot beside a marker's; else a file of poses alone holds the flange's, too.
    """
    keys = replace(_FLANGE, bare=False) if beside else _FLANGE
    return _of_documents(path, unit, keys) if path.suffix.lower() in SUFFIXES else None


def _of_documents(path: Path, unit: str | None, keys: _Keys) -> MarkerPoses | None:
    """Poses of one kind in a YAML, JSON or XML file; None where its first entry holds none."""
    found = documents(path)
    if len(found) == 1 and isinstance(found[0], dict):
        of_lists = _of_lists(path, found[0], unit, keys)
        if of_lists is not None:
            return of_lists
        lower = {str(key).lower(): value for key, value in found[0].items()}
        listed = next((lower[name] for name in ("samples", "transforms", "poses", *keys.lists) if name in lower), None)
        listed = listed.get("transforms", listed.get("poses")) if isinstance(listed, dict) else listed
        found = listed if isinstance(listed, list) else found
    elif len(found) == 1 and isinstance(found[0], list):
        found = found[0]
    poses, names = [], []
    for k, one in enumerate(found):
        where = f"{path}: pose {k + 1}"
        part = _pose_part(one, keys)
        if part is None and not k:
            return None
        if part is None:
            raise CalibError(f"{where}: holds no pose of {keys.what}, as the ones before it do")
        poses.append(_of_matrix(where, part, unit) if isinstance(part, list) else _of_message(where, part, unit))
        names.append(str(one["pose"]) if isinstance(one, dict) and isinstance(one.get("pose"), str | int) else "")
    if not poses:
        return None
    named = tuple(names) if all(names) else None
    note = f"{len(poses)} poses of {keys.what}, lengths in {unit or 'm, as ROS has it'}"
    return MarkerPoses(np.stack(poses), named, note, _key_of(found[0], keys))


def _key_of(one: Any, keys: _Keys) -> str:
    """Name of the pose within a sample, in lower case; "" where it has none."""
    of = {str(key).lower(): value for key, value in one.items()} if isinstance(one, dict) else {}
    return next((key for key in keys.samples if isinstance(of.get(key), dict | list)), "")


def _pose_part(one: Any, keys: _Keys) -> dict[str, Any] | list[Any] | None:
    """The part of a message or sample that holds a pose: position and orientation, or the numbers of a matrix."""
    if isinstance(one, list):
        return one if keys.bare and number_array(one) is not None else None
    if not isinstance(one, dict):
        return None
    lower = {str(key).lower(): value for key, value in one.items()}
    if key := _key_of(one, keys):
        return _pose_part(lower[key], replace(keys, samples=(), bare=True))
    for key in ("pose", "transform") if keys.bare else ():
        part = _pose_part(lower.get(key), keys)
        if part is not None:
            return part
    if not keys.bare:
        return None
    return one if {"position", "orientation"} <= set(one) or {"translation", "rotation"} <= set(one) else None


def _of_message(where: str, part: dict[str, Any], unit: str | None) -> Array:
    shift = number_array(part.get("position", part.get("translation")))
    turn = number_array(part.get("orientation", part.get("rotation")))
    if shift is None or len(shift) != 3 or turn is None or len(turn) != 4:
        raise CalibError(f"{where}: three lengths and a quaternion x, y, z, w are needed")
    return _transform(where, turn[[3, 0, 1, 2]], shift * UNITS_MM[unit or "m"])


def _of_matrix(where: str, part: list[Any], unit: str | None) -> Array:
    numbers = number_array(part)
    if numbers is None or len(numbers) != 16:
        raise CalibError(f"{where}: the 16 numbers of a 4 x 4 matrix are needed")
    matrix = numbers.reshape(4, 4)
    matrix = matrix if np.allclose(matrix[3], [0, 0, 0, 1]) else matrix.T
    if not np.allclose(matrix[3], [0, 0, 0, 1]) or not _are_rotations(matrix[:3, :3]):
        raise CalibError(f"{where}: the 4 x 4 matrix is no rigid transform")
    return frames.make_transform(matrix[:3, :3], matrix[:3, 3] * UNITS_MM[unit or "m"])


def _are_rotations(matrices: Array) -> bool:
    return bool(np.abs(matrices @ np.swapaxes(matrices, -1, -2) - np.eye(3)).max() < 1e-3)


def _transform(where: str, quaternion: Array, shift_mm: Array) -> Array:
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-2:
        raise CalibError(f"{where}: a quaternion of length {length:.4g}; a unit quaternion is needed")
    return frames.make_transform(frames.rotation_from_quaternion(quaternion), shift_mm)


def _of_lists(path: Path, document: dict[str, Any], unit: str | None, keys: _Keys) -> MarkerPoses | None:
    """Poses of a document with lists of rotations and shifts; None where it has none."""
    values = {str(key).lower(): value for key, value in document.items()}
    turns = next((name for name in keys.rotations if name in values), None)
    shifts = next((name for name in keys.shifts if name in values), None)
    if turns is None and shifts is None:
        return None
    if turns is None or shifts is None:
        raise CalibError(
            f"{path}: has one of {keys.rotations[0]} and {keys.shifts[0]}; both are needed for the poses of {keys.what}"
        )
    shift, turn = _rows(values[shifts], (3,)), _rows(values[turns], (9, 3))
    if shift is None or turn is None or len(shift) != len(turn):
        raise CalibError(
            f"{path}: as many {turns} (or 3 x 3 matrices) as {shifts} are needed, found {_count(turn)} and "
            f"{_count(shift)}"
        )
    unit = _required(path, unit)
    rotation = turn.reshape(-1, 3, 3) if turn.shape[1] == 9 else frames.rotation_from_rotvec(turn)
    if not _are_rotations(rotation):
        raise CalibError(f"{path}: a matrix among the rotations is none")
    poses = frames.make_transform(rotation, shift * UNITS_MM[unit])
    poses = frames.invert(poses) if keys.inverse in turns else poses
    return MarkerPoses(poses, None, f"{len(turn)} poses of {keys.what}")


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
    columns = flange_columns(table)
    if columns is None or not (len(columns.attitude) == 4 or VECTOR in columns.forms):
        raise CalibError(
            f"{path}: line 1: found {', '.join(table.columns)}; columns x, y, z or tx, ty, tz are needed, and a "
            "quaternion qx, qy, qz, qw or a rotation vector rx, ry, rz"
        )
    told = split_unit(columns.place[0])[1]
    unit = _required(path, told if told in UNITS_MM else unit)
    shift_mm, turn = _numbers(table, columns.place, faults) * UNITS_MM[unit], _numbers(table, columns.attitude, faults)
    if len(columns.attitude) == 4 and not faults:
        poses = [_transform(f"{path}: line {table.lines[i]}", turn[i], shift_mm[i]) for i in range(len(shift_mm))]
    elif not faults:
        in_deg = UNITS.get(split_unit(columns.attitude[0])[1], "") == "deg"
        poses = list(frames.make_transform(frames.rotation_from_rotvec(np.radians(turn) if in_deg else turn), shift_mm))
    if faults:
        raise CalibError("\n".join(faults))
    if not len(shift_mm):
        raise CalibError(f"{path}: holds no pose of a marker")
    named = {name.strip().lower(): name for name in table.columns}
    pose = next((named[name] for name in ("pose", "image", "id", "name") if name in named), None)
    names = None if pose is None else tuple(table.text(pose))
    return MarkerPoses(np.stack(poses), names, f"{len(poses)} poses of a marker, lengths in {unit}")


def _numbers(table: UserTable, names: Sequence[str], faults: list[str]) -> Array:
    return np.column_stack([table.numbers(name, lambda fault: faults.append(str(fault))) for name in names])
