"""Columns of a table with poses of the flange: a place, and three or four numbers of an attitude.

Controllers write them beside the joints, where they are what its own table makes of these and measure nothing. Tables
seldom tell how an attitude's numbers are meant: KUKA's A B C are turns about z, y', x'', Fanuc's W P R and ROS's roll,
pitch, yaw about the fixed x, y, z, Stäubli's about x, y', z'', Kawasaki's O A T about z, y', z'', UR's a rotation
vector; ABB's quaternions begin with w, ROS's end with it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calib.text_files.column_names import plain, split_unit
from calib.text_files.user_table import UserTable

VECTOR, FIXED, ZYX, XYZ, ZYZ = "a rotation vector", "fixed x, y, z", "z, y', x''", "x, y', z''", "z, y', z''"
ANY_FORM = (VECTOR, FIXED, ZYX, XYZ, ZYZ)
_TURNS = {
    ("rx", "ry", "rz"): ANY_FORM,
    ("a", "b", "c"): (ZYX, ZYZ, FIXED, XYZ),
    ("w", "p", "r"): (FIXED,),
    ("o", "a", "t"): (ZYZ,),
    ("roll", "pitch", "yaw"): (FIXED,),
    ("rvecx", "rvecy", "rvecz"): (VECTOR,),
    ("rotx", "roty", "rotz"): (VECTOR,),
    ("r1", "r2", "r3"): ANY_FORM,
}
_QUATERNIONS = (("qw", "qx", "qy", "qz"), ("q1", "q2", "q3", "q4"))  # of the second the file does not tell the order
_ENTRY = re.compile(r"([a-z]+?)([0-4])([0-4])")  # of a matrix, by its row and column
_PLACES = (("x", "y", "z"), ("tx", "ty", "tz"), ("px", "py", "pz"))


@dataclass(frozen=True)
class FlangeColumns:
    """Columns of a place and an attitude, and what the attitude's numbers may be."""

    place: tuple[str, ...]
    attitude: tuple[str, ...]
    forms: tuple[str, ...]  # () for a quaternion or a matrix


def has_flange_poses(table: UserTable) -> bool:
    """Whether a table with a header has columns of places and attitudes, as of a flange or tool."""
    return table.has_header and flange_columns(table) is not None


def flange_columns(table: UserTable) -> FlangeColumns | None:
    """Columns of the first place and the first attitude that the header names, behind a common word or alone."""
    names = {plain(split_unit(name)[0]): name for name in reversed(table.columns)}
    if numbered := _numbered(table):
        return FlangeColumns(numbered[:3], numbered[3:], ANY_FORM)
    for before in dict.fromkeys(["", *(name[:-1] for name in names if name[-1:] == "x")]):

        def found(wanted: Sequence[str], before: str = before) -> tuple[str, ...]:
            each = [names.get(before + name, names.get(name, "")) for name in wanted]
            return tuple(each) if all(each) else ()

        place = next(filter(None, map(found, _PLACES)), ())
        if not place or any(f"{before}x" == turns[0] for turns in _TURNS):
            continue
        for turns, forms in _TURNS.items():
            if attitude := found(turns):
                return FlangeColumns(place, attitude, forms)
        for quaternion in _QUATERNIONS:
            if (attitude := found(quaternion)) and "q5" not in names:  # else they are joints
                return FlangeColumns(place, attitude, ())
    return _matrix(names)


def _matrix(names: Mapping[str, str]) -> FlangeColumns | None:
    """Columns of a matrix by row and column, such as m00 ... m23, or r11 ... r33 with tx, ty, tz; row by row."""
    of_stem: dict[str, dict[tuple[int, int], str]] = {}
    for base, name in names.items():
        if match := _ENTRY.fullmatch(base):
            of_stem.setdefault(match[1], {})[int(match[2]), int(match[3])] = name
    for entries in of_stem.values():
        first = min(entries)[0]
        place = next((each for each in _PLACES if all(axis in names for axis in each)), ())
        if len(entries) == 9 and place:
            entries |= {(first + k, first + 3): names[axis] for k, axis in enumerate(place)}
        size = len(entries) // 4
        whole = {(first + i, first + j) for i in range(size) for j in range(4)}
        if size in (3, 4) and entries.keys() == whole:
            return FlangeColumns((), tuple(entries[key] for key in sorted(entries)), ())
    return None


def _numbered(table: UserTable) -> tuple[str, ...]:
    """Six columns of a pose that are numbered 0 to 5, such as actual_TCP_pose_0: a place, then a rotation vector."""
    stems: dict[str, list[str]] = {}
    for name in table.columns:
        bare = name.rstrip("]")
        if bare[-1:] in "012345" and "pose" in bare.lower() and "target" not in bare.lower():
            stems.setdefault(bare[:-1], []).append(name)
    return next((tuple(columns) for columns in stems.values() if len(columns) == 6), ())
