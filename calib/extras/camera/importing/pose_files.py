"""Poses of a marker in the camera's frame, and of the flange beside them, that another program wrote.

ROS messages (PoseStamped, TransformStamped), samples of easy_handeye and easy_handeye2 (`optical` or `tracking`, and
`robot`), of MoveIt's hand-eye calibration (`object_wrt_sensor`, `effector_wrt_world`, matrices), OpenCV's FileStorage
and plain JSON or YAML (lists `rvecs` and `tvecs`, or `R_target2cam` and `t_target2cam`, `R_gripper2base` and
`t_gripper2base`). Any other file is a table whose numbers are read as those of the flange's poses are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset_import.flange_poses import FlangePoses, length_of, readings_of
from calib.errors import CalibError
from calib.extras.camera.importing.documents import SUFFIXES, by_lower_name, documents, number_array
from calib.text_files.user_table import load_table

EASY_HANDEYE = "robot"  # name of the arm's pose in a sample of easy_handeye
_LISTS = ("samples", "transforms", "poses")  # names of a list of samples


@dataclass(frozen=True)
class PoseKeys:
    """Names by which files have one kind of poses, in lower case."""

    what: str
    samples: tuple[str, ...]  # of a pose within a sample
    lists: tuple[str, ...]  # of a list of all poses
    places: tuple[str, ...]
    turns: tuple[str, ...]


_ANY = PoseKeys("any", ("pose", "transform"), _LISTS, ("position", "translation"), ("orientation", "rotation"))
MARKER = PoseKeys(
    "a marker",
    ("optical", "tracking", "object_wrt_sensor", "camera_t_marker", "camera", "marker", "object", "target"),
    ("camera_marker_samples", "marker_poses"),
    ("tvecs", "tvec", "t_target2cam"),
    ("rvecs", "rvec", "r_target2cam"),
)
FLANGE = PoseKeys(
    "the flange",
    (EASY_HANDEYE, "effector_wrt_world", "base_t_flange", "effector", "gripper", "flange", "hand"),
    ("hand_world_samples", "robot_poses"),
    ("t_gripper2base", "t_base2gripper"),
    ("r_gripper2base", "r_base2gripper"),
)
_INVERSE = "base2gripper"  # in names of the inverse poses


@dataclass(frozen=True)
class PoseFile:
    """Poses of a marker in the camera's frame, or of the flange in the base's, as every reading of a file has them."""

    readings: tuple[FlangePoses, ...]
    names: tuple[Sequence[str], ...] = ()  # columns by which its rows may be named
    key: str = ""  # name of the poses within the file's samples


def marker_poses(path: Path) -> PoseFile:
    """Poses of a marker that a file holds. Raises CalibError."""
    found = poses_of_document(path, MARKER) if path.suffix.lower() in SUFFIXES else None
    if found is not None:
        return found
    if path.suffix.lower() in SUFFIXES and path.suffix.lower() != ".json":
        seen = ", ".join(map(str, dict.fromkeys(key for one in documents(path) for key in by_lower_name(one))))
        raise CalibError(
            f"{path}: holds no pose of a marker (found {seen[:200] or 'no names'}); a PoseStamped, a TransformStamped, "
            f"a sample with {', '.join(MARKER.samples[:3])}, or lists rvecs and tvecs are read"
        )
    table = load_table(path, any_encoding=True)
    readings = tuple(readings_of(table, what=MARKER.what))
    used = readings[0].columns
    return PoseFile(readings, tuple(table.text(name) for name in table.columns if name not in used))


def poses_of_document(path: Path, keys: PoseKeys, *, named: bool = False) -> PoseFile | None:
    """Poses of one kind in a YAML, JSON or XML file; None where its first entry holds none. Raises CalibError.

    named: whether only poses count whose names tell their kind, as beside others.
    """
    bare = replace(keys, samples=(), lists=(), places=(), turns=()) if named else _ANY
    samples = [one for document in documents(path) for one in _samples(document, keys, bare)]
    found = [_pose(f"{path}: pose {k + 1}", one, keys, bare) for k, one in enumerate(samples)]
    if not found or found[0] is None:
        return None
    poses = [one for one in found if one is not None]
    if len(poses) < len(found):
        where = f"{path}: pose {found.index(None) + 1}"
        raise CalibError(f"{where}: holds no pose of {keys.what}, as the ones before it do")
    scale, unit = length_of("", np.stack([place for place, _ in poses]))
    turns = np.stack([turn for _, turn in poses])
    transforms = frames.make_transform(turns, scale * np.stack([place for place, _ in poses]))
    first = by_lower_name(samples[0])
    if any(_INVERSE in name for name in first):
        transforms = frames.invert(transforms)
    names = [[str(one[key]) for one in samples] for key in ("pose", "image") if _all_name(samples, key)]
    key = next((name for name in keys.samples if name in first), "")
    form = f"{len(poses)} poses of {keys.what}, lengths in {unit}"
    return PoseFile((FlangePoses(transforms, form),), tuple(names), key)


def _all_name(samples: Sequence[Any], key: str) -> bool:
    return all(isinstance(one, dict) and isinstance(one.get(key), str | int) for one in samples)


def _samples(content: Any, keys: PoseKeys, bare: PoseKeys) -> list[Any]:
    """Samples of a document, one a pose: its list of them, its lists of places and turns side by side, or itself."""
    if isinstance(content, list):
        return content
    entries = by_lower_name(content)
    lists = next((entries[name] for name in (*keys.lists, *_LISTS) if isinstance(entries.get(name), list | dict)), None)
    if lists is not None:
        return _samples(lists, keys, bare)
    columns = {name: _rows(entries[name]) for name in (*keys.places, *keys.turns) if name in entries}
    counts = {len(rows) for rows in columns.values()}
    if len(counts) > 1:
        raise CalibError(f"{', '.join(columns)}: {sorted(counts)} entries; as many of each are needed")
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)] or [content]


def _rows(value: Any) -> list[Any]:
    """Entries of a list, or rows of a matrix."""
    if isinstance(value, dict) and (flat := number_array(value)) is not None:
        rows: list[Any] = flat.reshape(int(value["rows"]), -1).tolist()
        return rows
    return value if isinstance(value, list) else []


def _pose(where: str, one: Any, keys: PoseKeys, bare: PoseKeys) -> tuple[Array, Array] | None:
    """Place (3,) in the file's unit and rotation (3, 3) of a sample or message; None where it has none of this kind."""
    entries = by_lower_name(one)
    for name in (*keys.samples, *bare.samples):
        if isinstance(entries.get(name), dict | list):
            return _pose(where, entries[name], replace(keys, samples=()), _ANY)
    numbers = number_array(one) if bare.places and isinstance(one, list) else None
    if numbers is not None and len(numbers) == 16:
        matrix = numbers.reshape(4, 4)
        matrix = matrix if np.allclose(matrix[3], [0, 0, 0, 1]) else matrix.T
        return matrix[:3, 3], _rotation(where, matrix[:3, :3].ravel())
    place = _first(entries, (*keys.places, *bare.places))
    turn = _first(entries, (*keys.turns, *bare.turns))
    if place is None and turn is None:
        return None
    if place is None or len(place) != 3 or turn is None:
        raise CalibError(f"{where}: three lengths and an attitude are needed")
    return place, _rotation(where, turn)


def _first(entries: dict[str, Any], names: Sequence[str]) -> Array | None:
    return next((number_array(entries[name]) for name in names if name in entries), None)


def _rotation(where: str, numbers: Array) -> Array:
    """Rotation (3, 3) of a matrix (9,), of a quaternion x, y, z, w or of a rotation vector."""
    if len(numbers) == 9:
        matrix = numbers.reshape(3, 3)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-3:
            return matrix
    if len(numbers) == 4 and abs(np.linalg.norm(numbers) - 1.0) < 1e-2:
        return frames.rotation_from_quaternion(numbers[[3, 0, 1, 2]])
    if len(numbers) == 3:
        return frames.rotation_from_rotvec(numbers)
    raise CalibError(f"{where}: a rotation matrix, a unit quaternion x, y, z, w or a rotation vector is needed")
