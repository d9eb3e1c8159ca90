"""Columns of places and poses by their names: the measured point, markers, and what a controller computes.

Controllers write poses beside the joints, where they are what its own table makes of these and measure nothing. Tables
seldom tell how an attitude's numbers are meant: KUKA's A B C are turns about z, y', x'', Fanuc's W P R and ROS's roll,
pitch, yaw about the fixed x, y, z, Stäubli's about x, y', z'', Kawasaki's O A T about z, y', z'', UR's a rotation
vector; ABB's quaternions begin with w, ROS's end with it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.dataset_import.column_words import AXES, POLAR, WORDS, is_called, kind_of_marker, words_of
from calib.text_files.column_names import ANGLES_RAD, GON_RAD, LENGTHS_MM, plain, split_unit
from calib.text_files.user_table import UserTable

Triple = tuple[str, str, str]
Markers = dict[str, Triple]
"""Columns x, y, z by the name of the marker or point that they are of."""
MEASURED, PLAIN, NAMED, NONE = range(4)
VECTOR, FIXED, ZYX, XYZ, ZYZ = "a rotation vector", "fixed x, y, z", "z, y', x''", "x, y', z''", "z, y', z''"
ANY_FORM = (VECTOR, FIXED, ZYX, XYZ, ZYZ)
_KNOWN = "|".join(sorted((*WORDS["measured"], *WORDS["actual"], *WORDS["place"]), key=len, reverse=True))
_FORMS = tuple(
    re.compile(form, re.IGNORECASE)
    for form in (
        r"(?P<stem>)(?P<axis>[xyz])(?P<after>)",
        r"(?P<stem>.*?\w.*?)(?:[\W_]+|(?<=\d)|(?<=[a-z])(?=[XYZ]))(?P<axis>[xyz])(?P<after>)",
        r"(?P<after>)(?P<axis>[xyz])(?:[\W_]+|(?=\d))(?P<stem>.*\w.*)",
        r"(?P<stem>.*?\w.*?)[\W_]+(?P<axis>[xyz])[\W_]+(?P<after>.*\w.*)",
        rf"(?P<after>)(?P<axis>[xyz])(?P<stem>(?:{_KNOWN})+)",
    )
)
_NUMBERED = re.compile(r"(?P<stem>.*?)[\W_]*(?P<number>\d{1,9})\W?")
_PLACES = ("x y z", "tx ty tz", "px py pz")
_TURNS: dict[str, tuple[str, ...]] = {  # () of forms: a quaternion, of the last in an order not told
    "rx ry rz": ANY_FORM,
    "a b c": (ZYX, ZYZ, FIXED, XYZ),
    "w p r": (FIXED,),
    "o a t": (ZYZ,),
    "roll pitch yaw": (FIXED,),
    "rvecx rvecy rvecz": (VECTOR,),
    "rotx roty rotz": (VECTOR,),
    "r1 r2 r3": ANY_FORM,
    "qw qx qy qz": (),
    "q1 q2 q3 q4": (),
}
_ANGLES = ANGLES_RAD | {"gon": GON_RAD}
_CIRCLES = (("rad", 2.0 * np.pi), ("deg", 360.0), ("gon", 400.0))
_ENTRY = re.compile(r"([a-z]+?)([0-4])([0-4])")  # of a matrix, by its row and column


@dataclass(frozen=True)
class PoseColumns:
    """Columns of a place and an attitude, and what the attitude's numbers may be."""

    place: tuple[str, ...]
    attitude: tuple[str, ...]
    forms: tuple[str, ...]  # () for a quaternion or a matrix


def _by_stem(names: Sequence[str]) -> dict[str, dict[str, str]]:
    """Columns of each place by their axes, by what stands beside the axis in their names."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        base, unit = split_unit(name)
        base = AXES.get(plain(base), base.strip())
        match = next((m for form in _FORMS if (m := form.fullmatch(base))), None)
        if match is not None and unit in ("", *LENGTHS_MM):
            stem = f"{match['stem']} {match['after']}".strip(" _./-")
            found.setdefault(stem, {}).setdefault(match["axis"].lower(), name)
    return found


def _kind(stem: str, *, has_nominal: bool) -> int:
    """Whether a place is named as measured, has no name but such as all places have, one of its own, or is none."""
    if is_called(stem, "own", "commanded", "robot", "rate", "no place", "nominal", "deviation", apart=False):
        return NONE
    known = re.fullmatch(rf"(?:{_KNOWN})*|1", plain(stem))
    words = re.findall(_KNOWN, plain(stem))
    if known is None or (not has_nominal and WORDS["actual"] & set(words)):
        return NAMED
    return MEASURED if (WORDS["measured"] | WORDS["actual"]) & set(words) else PLAIN


def point_columns(names: Sequence[str]) -> dict[str, str]:
    """Axis of each column of the measured point: a whole point before single ones, one said to be measured first."""
    has_nominal = any(is_called(name, "nominal") for name in names)
    found = _by_stem(names)
    kinds = {stem: _kind(stem, has_nominal=has_nominal) for stem in found}
    ranked = sorted((stem for stem in found if kinds[stem] < NAMED), key=lambda stem: (-len(found[stem]), kinds[stem]))
    if ranked and len(found[ranked[0]]) == 3:
        return {name: axis for axis, name in found[ranked[0]].items()}
    groups = point_groups(names)
    named = {stem: columns for stem, columns in groups.items() if not is_called(stem, "actual")}
    groups = named if len(named) == 1 else groups
    several = groups if len(groups) == 1 else marker_columns(names)
    numbered = [columns for stem, columns in _numbered(names).items() if re.fullmatch(rf"(?:{_KNOWN}|xyz)s?", stem)]
    if several or [len(columns) for columns in numbered] == [3]:  # the latter such as p[0], p[1], p[2]
        return dict(zip(next(iter(several.values()), tuple(numbered[0]) if numbered else ()), "xyz", strict=True))
    return {name: axis for stem in reversed(ranked) for axis, name in found[stem].items()}


def point_groups(names: Sequence[str]) -> Markers:
    """Columns x, y, z of each point, by what stands beside the axis in their names.

    Nominal points, deviations, turns and the controller's own poses are none.
    """
    whole = {stem: axes for stem, axes in _by_stem(names).items() if len(axes) == 3}
    return {s: (a["x"], a["y"], a["z"]) for s, a in whole.items() if _kind(s, has_nominal=True) < NONE}


def marker_columns(names: Sequence[str]) -> Markers:
    """Columns x, y, z of each of several markers, such as T1_x ... T2_x ..., or x1 ... x2 ..., by the markers' names.

    {} unless their names differ by numbers or single letters alone, or all have a word for a marker.
    """
    kinds: dict[str, Markers] = {}
    for stem, columns in point_groups(names).items():
        kinds.setdefault(kind_of_marker(stem), {})[stem or "1"] = columns
    most = max(kinds.values(), key=len, default={})
    return most if len(most) > 1 else {}


def is_beside_point(name: str) -> bool:
    """Whether a column beside the measured point is a further or nominal point, or how far the point is from it."""
    of_axis = bool(words_of(name) & {"x", "y", "z"}) and is_called(name, "nominal", "deviation")
    return of_axis or re.fullmatch(r"[xyz]\d{1,3}", plain(split_unit(name)[0])) is not None


def own_pose_columns(names: Sequence[str]) -> Triple | None:
    """Columns with the place of a controller's tool, such as actual_TCP_pose_0 to 2 or tcp_x, tcp_y, tcp_z.

    None where there are none, or several sets of them.
    """
    places = {stem: (of["x"], of["y"], of["z"]) for stem, of in _by_stem(names).items() if len(of) == 3}
    sets = [
        (x, y, z)
        for name, (x, y, z) in (places | {c[0]: (c[0], c[1], c[2]) for c in _numbered_poses(names)}).items()
        if is_called(name, "own", apart=False)
        and not is_called(name, "commanded", "rate", "no place", "label", apart=False)
    ]
    return sets[0] if len(sets) == 1 else None


def pose_columns(names: Sequence[str]) -> PoseColumns | None:
    """Columns of the first place and the first attitude that names tell, behind a common word or alone."""
    by_name = {plain(split_unit(name)[0]): name for name in reversed(names)}
    for numbered in _numbered_poses(names):
        return PoseColumns(numbered[:3], numbered[3:], ANY_FORM)
    for before in dict.fromkeys(["", *(name[:-1] for name in by_name if name[-1:] == "x")]):

        def found(wanted: str, before: str = before) -> tuple[str, ...]:
            each = [by_name.get(before + name, by_name.get(name, "")) for name in wanted.split()]
            return tuple(each) if all(each) else ()

        place = next(filter(None, map(found, _PLACES)), ())
        for turns, forms in _TURNS.items() if place else ():
            attitude = found(turns)
            of_joints = turns.startswith("q1") and "q5" in by_name
            if attitude and not of_joints and set(place).isdisjoint(attitude):
                return PoseColumns(place, attitude, forms)
    matrices = (columns for columns in _numbered(names).values() if len(columns) in (12, 16))
    return _matrix(by_name) or next((PoseColumns((), columns, ()) for columns in matrices), None)


def has_poses(table: UserTable) -> bool:
    """Whether a table with a header has columns of places and attitudes, as of a flange or tool."""
    return table.has_header and pose_columns(table.columns) is not None


def _matrix(by_name: Mapping[str, str]) -> PoseColumns | None:
    """Columns of a matrix by row and column, such as m00 ... m23, or r11 ... r33 with tx, ty, tz; row by row."""
    of_stem: dict[str, dict[tuple[int, int], str]] = {}
    for base, name in by_name.items():
        if match := _ENTRY.fullmatch(base):
            of_stem.setdefault(match[1], {})[int(match[2]), int(match[3])] = name
    for entries in of_stem.values():
        first = min(entries)[0]
        place = next((each for each in map(str.split, _PLACES) if by_name.keys() >= set(each)), [])
        if len(entries) == 9 and place:
            entries |= {(first + k, first + 3): by_name[axis] for k, axis in enumerate(place)}
        size = len(entries) // 4
        whole = {(first + i, first + j) for i in range(size) for j in range(4)}
        if size in (3, 4) and entries.keys() == whole:
            return PoseColumns((), tuple(entries[key] for key in sorted(entries)), ())
    return None


def _numbered(names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Numbered columns, in the order of their numbers, by what stands before these."""
    found: dict[str, dict[int, str]] = {}
    for name in names:
        if match := _NUMBERED.fullmatch(split_unit(name)[0].lower()):
            found.setdefault(match["stem"], {})[int(match["number"])] = name
    return {stem: tuple(columns[k] for k in sorted(columns)) for stem, columns in found.items()}


def _numbered_poses(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Six columns of each pose that is numbered, such as actual_TCP_pose_0 ...: a place, then a rotation vector."""
    numbered = _numbered(names)
    return [c for stem, c in numbered.items() if len(c) == 6 and "pose" in stem and "target" not in stem]


# ---- two angles and a distance, as total stations and trackers tell a point ------------------------------------------


def polar_columns(names: Sequence[str]) -> dict[str, str]:
    """Columns of an azimuth, a height and a distance by their kind; {} where there are not all, or x, y, z as well."""
    named = {plain(split_unit(name)[0]): name for name in reversed(names)}
    found = {kind: named[word] for kind, words in POLAR.items() for word in reversed(words) if word in named}
    heights = [kind for kind in ("zenith", "elevation", "height") if kind in found]
    is_whole = heights and {"azimuth", "distance"} <= set(found) and len(point_columns(names)) < 3
    return {kind: found[kind] for kind in ("azimuth", heights[0], "distance")} if is_whole else {}


def with_places(table: UserTable) -> tuple[UserTable, list[Triple]]:
    """The table with places in place of angles and distances, and the columns of each reading of them; [] of none.

    Azimuths count from x to y or, as a total station's, from north (y) to east (x); heights are counted from the zenith
    or from the horizon. The way is the one in which the arm meets the points (`calib.dataset_import.plan`).
    """
    polar = polar_columns(table.columns) if table.has_header else {}
    if not polar:
        return table, []
    azimuth, up, distance = table.known(polar.values()).T
    told, unit = (split_unit(polar[kind])[1] for kind in ("azimuth", "distance"))
    largest = float(np.nanmax(np.abs([azimuth, up])))
    likely = [unit for unit, turn in _CIRCLES if largest <= 1.001 * turn][: 1 if largest <= _CIRCLES[0][1] else None]
    columns: dict[str, list[str]] = {n: table.text(n) for n in table.columns if n not in polar.values()}
    readings: list[Triple] = []
    for angle in [told] if told in _ANGLES else likely:
        turn, height = _ANGLES[angle] * azimuth, _ANGLES[angle] * up
        for above in [np.pi / 2.0 - height] * ("elevation" not in polar) + [height] * ("zenith" not in polar):
            x, y, z = np.cos(above) * np.cos(turn), np.cos(above) * np.sin(turn), np.sin(above)
            for places in ((x, y, z), (y, x, z)):
                ends = (f"reading {len(readings) + 1}{letter}" for letter in "abc") if readings else iter("xyz")
                a, b, c = (f"{end} [{unit}]" if unit else end for end in ends)
                readings.append((a, b, c))
                for name, axis in zip(readings[-1], places, strict=True):
                    columns[name] = ["" if np.isnan(v) else repr(v) for v in (distance * axis).tolist()]
    rows = tuple(zip(*columns.values(), strict=True))
    return replace(table, columns=tuple(columns), rows=rows), readings
