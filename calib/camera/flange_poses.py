"""Poses of the flange in a table, in every way in which its numbers may be meant.

Controllers write a place and three or four numbers for the attitude, and tables seldom tell which: KUKA's A B C are
turns about z, y', x'', Fanuc's W P R and ROS's roll, pitch, yaw about the fixed x, y, z, Stäubli's about x, y', z'',
Kawasaki's O A T about z, y', z'', UR's a rotation vector; ABB's quaternions begin with w, ROS's end with it. What a
camera saw at the poses tells which it is (`calib.dataset_import.cartesian_poses`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.errors import CalibError
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import UNITS, UserTable, plain, split_unit

_REACH_M = 20.0  # places below are metres where no unit is told
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
_VECTOR, _FIXED, _ZYX, _XYZ, _ZYZ = "a rotation vector", "fixed x, y, z", "z, y', x''", "x, y', z''", "z, y', z''"
_ANY = (_VECTOR, _FIXED, _ZYX, _XYZ, _ZYZ)
_TURNS = {
    ("rx", "ry", "rz"): _ANY,
    ("a", "b", "c"): (_ZYX, _ZYZ, _FIXED, _XYZ),
    ("w", "p", "r"): (_FIXED,),
    ("o", "a", "t"): (_ZYZ,),
    ("roll", "pitch", "yaw"): (_FIXED,),
    ("rvecx", "rvecy", "rvecz"): (_VECTOR,),
}
_QUATERNIONS = (("qw", "qx", "qy", "qz"), ("q1", "q2", "q3", "q4"))  # of the second the file does not tell the order
_PLACES = (("x", "y", "z"), ("tx", "ty", "tz"), ("px", "py", "pz"))


@dataclass(frozen=True)
class FlangePoses:
    """Poses of the flange as one reading of a file has them."""

    base_T_flange: Array  # (N, 4, 4) mm
    form: str  # how the numbers were read, for people
    columns: tuple[str, ...] = ()  # of a table that they were read from


@dataclass(frozen=True)
class _Columns:
    """Columns of a place and an attitude, and what the attitude's numbers may be."""

    place: tuple[str, ...]
    attitude: tuple[str, ...]
    forms: tuple[str, ...]  # () for a quaternion or a matrix


def has_flange_poses(table: UserTable) -> bool:
    """Whether a table with a header has columns of places and attitudes, as of a flange or tool."""
    return table.has_header and bool(_by_name(table))


def readings_of(table: UserTable) -> list[FlangePoses]:
    """Every reading of a table's flange poses, the usual ones first. Raises CalibError where there is none."""
    choices = _by_name(table) if table.has_header else _by_number(table)
    if not choices:
        raise CalibError(
            f"{table.path}: line 1: found {', '.join(table.columns[:30])}; poses of the flange are x, y, z with "
            "rx, ry, rz, with a, b, c, with roll, pitch, yaw, or with qx, qy, qz, qw"
        )
    return [one for columns in choices for one in _readings(table, columns)]


def _by_name(table: UserTable) -> list[_Columns]:
    """Columns of the first place and the first attitude that the header names, behind a common word or alone."""
    names = {plain(split_unit(name)[0]): name for name in reversed(table.columns)}
    if numbered := _numbered(table):
        return [_Columns(numbered[:3], numbered[3:], _ANY)]
    for before in dict.fromkeys(["", *(name[:-1] for name in names if name[-1:] == "x")]):

        def found(wanted: Sequence[str], before: str = before) -> tuple[str, ...]:
            each = [names.get(before + name, names.get(name, "")) for name in wanted]
            return tuple(each) if all(each) else ()

        place = next(filter(None, map(found, _PLACES)), ())
        if not place:
            continue
        for turns, forms in _TURNS.items():
            if attitude := found(turns):
                return [_Columns(place, attitude, forms)]
        for quaternion in _QUATERNIONS:
            if (attitude := found(quaternion)) and "q5" not in names:  # else they are joints
                return [_Columns(place, attitude, ())]
    return []


def _numbered(table: UserTable) -> tuple[str, ...]:
    """Six columns of a pose that are numbered 0 to 5, such as actual_TCP_pose_0: a place, then a rotation vector."""
    stems: dict[str, list[str]] = {}
    for name in table.columns:
        bare = name.rstrip("]")
        if bare[-1:] in "012345" and "pose" in bare.lower() and "target" not in bare.lower():
            stems.setdefault(bare[:-1], []).append(name)
    return next((tuple(columns) for columns in stems.values() if len(columns) == 6), ())


def _by_number(table: UserTable) -> list[_Columns]:
    """Columns of a table without a header by their number, behind names or times."""
    numbers = [name for name in table.columns if all(as_number(cell) is not None for cell in table.text(name))]
    out = []
    for count, forms in ((6, _ANY), (7, ()), (12, ()), (16, ())):
        if len(numbers) in (count, count + 1):
            first = 3 if count < 12 else 0
            last = tuple(numbers[-count:])
            out.append(_Columns(last[:first], last[first:], forms))
    return out


def _readings(table: UserTable, columns: _Columns) -> list[FlangePoses]:
    """Readings of some columns; none where the numbers are no attitude of that kind."""
    faults: list[str] = []

    def numbers(names: Sequence[str]) -> Array:
        return np.column_stack([table.numbers(name, lambda fault: faults.append(str(fault))) for name in names])

    attitude = numbers(columns.attitude)
    used = (*columns.place, *columns.attitude)
    if not columns.place:
        return [] if faults else _of_matrices(attitude, used)
    unit, place = split_unit(columns.place[0])[1], numbers(columns.place)
    if faults:
        raise CalibError("\n".join(faults))
    scale, length = _length(unit, place)
    if len(columns.attitude) == 4:
        by_name = any("w" in plain(name) for name in columns.attitude)
        orders = ((0, 1, 2, 3),) if by_name else ((0, 1, 2, 3), (3, 0, 1, 2))
        if np.abs(np.linalg.norm(attitude, axis=1) - 1.0).max() > 0.01:
            return []
        turns = [
            (f"quaternions{'' if by_name else ' w, x, y, z' if order[0] == 0 else ' x, y, z, w'}",
             frames.rotation_from_quaternion(attitude[:, order]))
            for order in orders
        ]  # fmt: skip
    else:
        told = UNITS.get(split_unit(columns.attitude[0])[1], "")
        likely = ["deg"] if np.abs(attitude).max() > 2.0 * np.pi else ["rad", "deg"]
        units = [told] if told in ("deg", "rad") else likely
        turns = [
            (f"{form} in {angle}" if form == _VECTOR else f"turns about {form} in {angle}",
             _rotations(form, np.radians(attitude) if angle == "deg" else attitude))
            for form in columns.forms
            for angle in units
        ]  # fmt: skip
    return [
        FlangePoses(frames.make_transform(turn, place * scale), f"{', '.join(used)} are {length} and {how}", used)
        for how, turn in turns
    ]


def _length(unit: str, place: Array) -> tuple[float, str]:
    """Factor of places to mm, and the unit's name: by the column's name, else by the arm's reach."""
    unit = unit if unit in _MM else "m" if np.abs(place).max() < _REACH_M else "mm"
    return _MM[unit], unit


def _of_matrices(numbers: Array, used: tuple[str, ...]) -> list[FlangePoses]:
    """Readings of rows of 12 or 16 numbers as matrices, row by row or column by column."""
    rows = numbers.reshape(len(numbers), -1, 4)
    turned = np.swapaxes(numbers.reshape(len(numbers), 4, -1), 1, 2)
    out = []
    for matrix, how in ((rows, "row by row"), (turned, "column by column")):
        rotation = matrix[:, :3, :3]
        if np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max() < 1e-2:
            scale, length = _length("", matrix[:, :3, 3])
            form = f"its numbers are matrices, {how}, in {length}"
            out.append(FlangePoses(frames.make_transform(rotation, matrix[:, :3, 3] * scale), form, used))
    return out[:1] if len(out) == 2 and np.allclose(out[0].base_T_flange, out[1].base_T_flange) else out


def _rotations(form: str, angles_rad: Array) -> Array:
    """Rotations (N, 3, 3) of three angles (N, 3) each, or of rotation vectors."""
    if form == _VECTOR:
        return frames.rotation_from_rotvec(angles_rad)
    axes = {_FIXED: "zyx", _ZYX: "zyx", _XYZ: "xyz", _ZYZ: "zyz"}[form]
    angles_rad = angles_rad[:, ::-1] if form == _FIXED else angles_rad
    first, second, third = (
        frames.rotation_from_rotvec(angles_rad[:, [k]] * np.eye(3)["xyz".index(axis)]) for k, axis in enumerate(axes)
    )
    return np.asarray(first @ second @ third)
