"""Reading of a user's tables: columns, joint values, points and their poses; faults are collected."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib.array_types import Array
from calib.dataset.input_names import quantity_of
from calib.dataset_import.columns import (
    AS_MAPPED,
    Column,
    Meaning,
    Recognised,
    length_column,
    numbered_joints,
    point_groups,
    recognise,
)
from calib.dataset_import.flange_columns import has_flange_poses
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, length_unit
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import Fault, RowFault, UserTable, plain, split_unit

_MOST_FAULTS = 20
_MOST_PLACES = 8  # that a fault lists
_MOST = 1e9  # degrees, micrometres
_MOST_DEG = 400.0  # of a joint
_FOLLOWS, _STANDS = 1e-3, 0.1  # of its range, by which a column may miss a sum of others; of the file's unit
_WHOLE = 0.01  # by which the shares of such a sum may miss whole numbers
_RECORDED = 300  # rows, from which a table may be a recording
_SMALL_STEP = 0.05  # of the whole motion, between two rows of a recording
_FAR_SPREAD = 2.0  # points spread by another factor than the arm's have a unit that cannot be told


@dataclass(frozen=True)
class LeftOutRow:
    """A row of a table of points that belongs to no pose, as of a nest or a drift point."""

    file: str
    row: int  # the line of the file
    name: str
    why: str


@dataclass
class ImportReport:
    """Notes, doubts, faults and rows left out that are collected during an import."""

    robot: Robot | None
    faults: list[Fault] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    left_out: list[LeftOutRow] = field(default_factory=list)

    def fault(self, message: Fault) -> None:
        """Add a fault."""
        self.faults.append(message)

    @property
    def row_faults(self) -> list[RowFault]:
        """Faults that concern single rows, each row's first."""
        first: dict[tuple[Path, int], RowFault] = {}
        for fault in self.faults:
            if isinstance(fault, RowFault):
                first.setdefault((fault.path, fault.line), fault)
        return list(first.values())

    def raise_all(self) -> None:
        """Raise DatasetError with all faults so far, if any."""
        if not self.faults:
            return
        shown = list(map(str, self.faults[:_MOST_FAULTS]))
        if len(self.faults) == 1:
            raise DatasetError(shown[0])
        more = [f"... and {len(self.faults) - len(shown)} more"] if len(self.faults) > len(shown) else []
        raise DatasetError("\n  ".join([f"nothing was written, {len(self.faults)} faults:", *shown, *more]))


def recognised(
    report: ImportReport, table: UserTable, mapping: Mapping[str, Meaning], *, positions: bool, joints: bool = True
) -> Recognised:
    """Recognised columns of a table; missing ones are reported as faults."""
    robot, by_place = report.robot, None
    if not table.has_header and robot is not None:
        wanted = [f"q{k + 1}" for k in range(robot.n_joints)] if joints else []
        for extra in ([], ["x", "y", "z"]) if joints else (["x", "y", "z"],):
            for first in ([], ["pose"]):
                if len(table.columns) == len(first + wanted + extra):
                    meanings = first + wanted + extra
                    if joints and extra and _has_points_first(table, len(first)):
                        meanings = first + extra + wanted
                    by_place = dict(zip(table.columns, meanings, strict=True))
                    report.notes.append(f"{table.path}: has no header; its columns are taken for {', '.join(meanings)}")
        of_numbers = [n for n in table.columns if all(as_number(cell) is not None for cell in table.text(n) if cell)]
        if by_place is None and not joints and len(of_numbers) == 3 < len(table.columns):
            by_place = dict(zip(of_numbers, "xyz", strict=True))
            report.notes.append(f"{table.path}: has no header; its columns of numbers are taken for x, y, z")
    unnamed = table.columns[0]
    if table.has_header and unnamed == "column 1":
        cells = table.text(unnamed)
        by_place = {unnamed: "pose"} if all(cells) and len(set(cells)) == len(cells) else None
    moving = moving_joints(table, robot) if joints and robot is not None and not mapping else []
    if moving and robot is not None:
        by_place = {name: f"q{k + 1}" for k, name in enumerate(moving)}
        report.notes.append(
            f"{table.path}: the {robot.n_joints} joints are {', '.join(moving)}: the other columns of joints stand "
            "still or follow these in all rows"
        )
    found = recognise(table.columns, robot, mapping, by_place)
    for words in found.faults:
        report.fault(f"{table.path}: line 1: {words}")
    have = ", ".join(table.columns[:30])
    if joints and robot is not None and not found.faults:
        missing = [f"q{k + 1}" for k in range(robot.n_joints) if f"q{k + 1}" not in found.columns]
        if len(missing) == robot.n_joints and has_flange_poses(table):
            report.fault(
                f"{table.path}: line 1: its columns are Cartesian poses ({have}), and the joints' values are needed: "
                "poses do not tell by which of several ways the arm reached them, nor what its table made of the "
                "joints; controllers and ROS (/joint_states) log these beside them. Where a camera saw a board at "
                "them, --images or --marker-poses finds the camera's place without"
            )
        elif missing and not table.has_header:
            n = robot.n_joints
            report.fault(
                f"{table.path}: line 1: no names stand above its {len(table.columns)} columns; {n} are taken for the "
                f"joints, {n + 3} for joints and x, y, z, each with the pose's name in front or not; write a line of "
                "names above them, such as pose,q1,q2"
            )
        elif missing:
            report.fault(
                f"{table.path}: line 1: {robot.n_joints} columns of joints are needed, q1 to q{robot.n_joints} or the "
                f"joints' names; found {have}; tell with --map {_numbered(table.columns, robot.n_joints)}"
            )
    if positions and not joints and length_column(found) is None:
        missing = [axis for axis in "xyz" if axis not in found.columns]
        if missing:
            report.fault(
                f"{table.path}: line 1: no column for {', '.join(missing)}{_several(table)}; found {have}; tell with "
                "--map column=x"
            )
    return found


def moving_joints(table: UserTable, robot: Robot) -> list[str]:
    """Columns of a robot's joints among more numbered ones that stand still or are sums of others; [] if unclear."""
    numbered = numbered_joints(table.columns)
    if len(numbered) <= robot.n_joints:
        return []
    kept: list[str] = []
    known = [np.ones(len(table))]
    for name in numbered:
        values = np.array([as_number(cell) or 0.0 for cell in table.text(name)])
        shares, *_ = np.linalg.lstsq(np.column_stack(known), values, rcond=None)
        off = np.abs(values - np.column_stack(known) @ shares).max(initial=0.0)
        is_whole = np.abs(shares[1:] - np.round(shares[1:])).max(initial=0.0) < _WHOLE
        if off > _FOLLOWS * max(float(np.ptp(values)), _STANDS) or not is_whole:
            kept.append(name)
            known.append(values)
    return kept if len(kept) == robot.n_joints else []


def _several(table: UserTable) -> str:
    """Part of a sentence that tells how to choose one of several points with names of their own."""
    groups = point_groups(table.columns)
    if len(groups) < 2:
        return ""
    first, *_ = groups.values()
    typed = " ".join(f"--map '{name}={axis}'" for name, axis in zip(first, "xyz", strict=True))
    return f"; several points stand there, {', '.join(groups)}: say which by {typed}"


def _numbered(names: Sequence[str], count: int) -> str:
    """What to type of --map: a pattern of as many numbered columns as there are joints, where there is one."""
    patterns = Counter(re.sub(r"\d+", "*", name, count=1) for name in names)
    found = [pattern for pattern, times in patterns.items() if "*" in pattern and times == count]
    return f"'{found[0]}=q*'" if len(found) == 1 else "column=q1"


def _has_points_first(table: UserTable, start: int) -> bool:
    """Whether the three columns from a place on are lengths, as they are too large for angles, and those behind not."""
    columns = [np.abs([as_number(cell) or 0.0 for cell in table.text(name)]).max() for name in table.columns[start:]]
    return bool(max(columns[:3]) > _MOST_DEG >= max(columns[3:]))


def joint_values(report: ImportReport, table: UserTable, meant: Recognised) -> Array | None:
    """Joint values (N, n) in the file's units; None, with a fault, where columns are missing."""
    if report.robot is None:  # its cells are judged all the same
        for name, column in meant.columns.items():
            if quantity_of(name) == "q":
                _numbers(report, table, column.name)
        return None
    names = [f"q{k + 1}" for k in range(report.robot.n_joints)]
    if not all(name in meant.columns for name in names):
        return None
    for k, (name, joint) in enumerate(zip(names, report.robot.joints, strict=True)):
        unit = meant.columns[name].unit
        if unit and unit not in (ANGLES_RAD if joint.is_revolute else LENGTHS_MM):
            report.fault(
                f"{table.path}: line 1, column {meant.columns[name].name}: {unit} is no unit of joint {k + 1} "
                f"({joint.name}), which is {joint.type}"
            )
    return np.column_stack([_numbers(report, table, meant.columns[name].name) for name in names])


def point_values(report: ImportReport, table: UserTable, meant: Recognised, *, needed: bool) -> Array | None:
    """Points (M, 3) in the file's unit; None where there are none."""
    if not all(axis in meant.columns for axis in "xyz"):
        is_told = any(str(fault).startswith(f"{table.path}: line 1: no ") for fault in report.faults)
        if needed and not is_told and length_column(meant) is None and not any(a in meant.columns for a in "xyz"):
            report.fault(
                f"{table.path}: line 1: no columns x, y, z{_several(table)}; give --points FILE.csv, --scans FOLDER or "
                "--map column=x"
            )
        return None
    points = np.column_stack([_coordinate(report, table, meant.columns[axis].name) for axis in "xyz"])
    blank = np.array([[not cell for cell in table.text(meant.columns[axis].name)] for axis in "xyz"]).T
    for i in np.flatnonzero(blank.any(axis=1) & ~blank.all(axis=1)):
        named = " and ".join(meant.columns["xyz"[k]].name for k in np.flatnonzero(blank[i]))
        found = f"{named} is empty; fill it in, or leave all three empty"
        report.fault(RowFault(table.path, table.lines[i], found))
    return points


def _numbers(report: ImportReport, table: UserTable, name: str) -> Array:
    """Numbers of a column; NaN, with a fault, for cells without a number or with one beyond any arm."""
    values = table.numbers(name, report.fault)
    for i in np.flatnonzero(np.abs(values) > _MOST):
        report.fault(RowFault(table.path, table.lines[i], f"found {values[i]:g}, which is far too large", name))
    return np.where(np.abs(values) > _MOST, np.nan, values)


def _coordinate(report: ImportReport, table: UserTable, name: str) -> Array:
    """Coordinates of a column; NaN for an empty cell, a point that was not measured."""
    blank = [not cell for cell in table.text(name)]
    if not any(blank):
        return _numbers(report, table, name)
    filled = replace(table, rows=tuple(tuple(cell or "0" for cell in row) for row in table.rows))
    return np.where(blank, np.nan, _numbers(report, filled, name))


def pose_ids(report: ImportReport, table: UserTable, meant: Recognised) -> list[str]:
    """Pose names of the rows of joints: from the table, else p1, p2, ..."""
    if "pose" not in meant.columns:
        return [f"p{table.position(i) + 1}" for i in range(len(table))]
    ids = table.text(meant.columns["pose"].name)
    first: dict[str, int] = {}
    for i, name in enumerate(ids):
        if not name:
            report.fault(RowFault(table.path, table.lines[i], "the cell is empty", meant.columns["pose"].name))
        elif first.setdefault(name, i) != i:
            line = table.lines[first[name]]
            where = f"{table.path}: line {table.lines[i]}: pose {name!r} stands in line {line} too"
            if "target" in meant.columns:
                report.fault(
                    f"{where}; several targets of a pose need two tables: --joints with a row a pose, --points "
                    "with pose, target, x, y, z"
                )
                break
            report.fault(f"{where}; each needs its own")
    return ids


def named_by_values(
    table: UserTable, meant: Recognised, other: UserTable, of_points: Recognised
) -> tuple[Recognised, Recognised]:
    """Recognised columns of the tables of joints and of points, the poses' names by the values that both have.

    Whatever two columns are called: where at least half of the points have a name that stands once in a column of the
    joints, that column names the poses. What the user maps stays.
    """
    if any(one.columns["pose"].why == AS_MAPPED for one in (meant, of_points) if "pose" in one.columns):
        return meant, of_points
    best, pair = 0, None
    for name in _possible_names(meant):
        cells = list(map(comparable_id, filter(None, table.text(name))))
        if len(set(cells)) != len(cells):
            continue
        for of_point in _possible_names(of_points):
            told = [cell for cell in map(comparable_id, other.text(of_point)) if cell in set(cells)]
            by_header = _is_pose(meant, name) and _is_pose(of_points, of_point)
            are_words = by_header or not all(cell.startswith("#") for cell in told)
            if are_words and len(told) > 1 and 2 * len(told) >= len(other) and len(told) + by_header > best:
                best, pair = len(told) + by_header, (name, of_point)
    if pair is None:
        return meant, of_points
    return _with_pose(meant, pair[0], other), _with_pose(of_points, pair[1], table)


def _is_pose(meant: Recognised, name: str) -> bool:
    return "pose" in meant.columns and meant.columns["pose"].name == name


def _possible_names(meant: Recognised) -> list[str]:
    """Columns that may name poses: the recognised one first, then those of no meaning, and a target's."""
    known = [meant.columns[key].name for key in ("pose", "target") if key in meant.columns]
    return [*known, *meant.rest]


def _with_pose(meant: Recognised, name: str, other: UserTable) -> Recognised:
    """The recognised columns with one that names the poses, as its values stand in another table."""
    before = meant.columns.get("pose")
    if before is not None and before.name == name:
        return meant
    columns = {key: column for key, column in meant.columns.items() if key != "pose" and column.name != name}
    columns["pose"] = Column(name, "pose", why=f"its values name the rows of {other.path.name}")
    rest = [one for one in meant.rest if one != name] + ([] if before is None else [before.name])
    return Recognised(columns, tuple(rest), meant.faults)


def without_strangers(
    report: ImportReport, table: UserTable, ids: Sequence[str], other: UserTable, of_points: Recognised
) -> UserTable:
    """Table of points without the rows that belong to no pose, which are told; as it is where most do.

    table: of the joints, whose rows have these ids.
    """
    if "pose" not in of_points.columns:
        return other
    known, named = set(map(comparable_id, ids)), other.text(of_points.columns["pose"].name)
    strange = [i for i, name in enumerate(named) if comparable_id(name) not in known]
    if not strange or 2 * len(strange) > len(other):
        return other
    why = f"its name is no pose of {table.path.name}"
    report.left_out += [LeftOutRow(other.path.name, other.lines[i], named[i], why) for i in strange]
    many = len(strange) > 1
    told = numbers.in_short([named[i][:40] or "one without a name" for i in strange], _MOST_PLACES)
    belong = f"{len(strange)} points belong to no pose and are" if many else "1 point belongs to no pose and is"
    report.notes.append(f"{other.path}: {belong} left out: {told}")
    return other.of_rows([i for i in range(len(other)) if i not in set(strange)])


def named_places(report: ImportReport, table: UserTable, meant: Recognised, places: UserTable) -> UserTable | None:
    """Table with a point a pose, where the joints' table names in each row which of some known places was visited.

    A place is a row of `places`, such as a socket of a plate; both tables have a column of one name for it. None where
    they have none; a place that is not listed is a fault.
    """
    free = {plain(split_unit(name)[0]): name for name in meant.rest}
    for name in places.columns:
        of_visit, listed = free.get(plain(split_unit(name)[0])), places.text(name)
        if of_visit is None or len(set(listed)) != len(listed) or "" in listed:
            continue
        row_of = {place: i for i, place in enumerate(listed)}
        visited = table.text(of_visit)
        if not set(visited) & set(row_of) or len(set(visited)) == len(visited):  # each once: names of poses
            continue
        rows, lines = [], []
        for k, (pose, place) in enumerate(zip(pose_ids(ImportReport(None), table, meant), visited, strict=True)):
            if place in row_of:
                rows.append((pose, *places.rows[row_of[place]]))
                lines.append(places.lines[row_of[place]])
            elif place:
                known = numbers.in_short(listed, _MOST_PLACES)
                found = f"{place[:40]!r} is not in {places.path} ({known})"
                report.fault(RowFault(table.path, table.lines[k], found, of_visit))
        report.notes.append(
            f"{places.path}: column {name} names the places that {table.path.name} visits: {len(rows)} visits of "
            f"{len(set(visited) & set(row_of))} places"
        )
        return UserTable(places.path, ("pose", *places.columns), tuple(rows), tuple(lines), has_header=True)
    return None


def named_by_cells(report: ImportReport, ids: list[str], table: UserTable, meant: Recognised) -> Recognised:
    """Recognised columns of a table of points, the pose's by its cells where no name tells it.

    A target that is the same in all rows and none of the robot's is the kind of the reflector, as trackers write it.
    """
    columns, rest = dict(meant.columns), list(meant.rest)
    target = columns.get("target")
    if "pose" not in columns:
        known = {*ids, *map(comparable_id, ids)}
        for name in [*rest, *([] if target is None else [target.name])]:
            cells = table.text(name)
            if len(set(cells)) > 1 and {*cells, *map(comparable_id, cells)} <= known:
                columns["pose"] = Column(name, "pose", why="its cells name the poses of the joints")
                break
    if target is not None and report.robot is not None:
        of_robot = {each.name for each in report.robot.targets} | {"jig"}
        kinds = set(table.text(target.name))
        if "pose" in columns and columns["pose"].name == target.name:
            del columns["target"]
        elif len(kinds) == 1 and not kinds <= of_robot:
            report.notes.append(f"{table.path}: column {target.name} is {kinds.pop()!r} in all rows and left out")
            del columns["target"]
            rest.append(target.name)
    used = {column.name for column in columns.values()}
    return Recognised(columns, tuple(name for name in rest if name not in used), meant.faults)


def placement_columns(table: UserTable, meant: Recognised, other: UserTable | None) -> list[str]:
    """Unrecognised columns of words, each several times: they may name where the instrument or a plate stood.

    other  # the table of points, whose columns are something else
    """
    if "setup" in meant.columns:
        return []
    found = []
    for name in meant.rest:
        if other is not None and plain(name) in map(plain, other.columns):
            continue
        cells = table.text(name)
        words = Counter(cell for cell in cells if as_number(cell) is None)
        if len(words) > 1 and sum(words.values()) == len(cells) and min(words.values()) > 1:
            found.append(name)
    return found


def rows_of_points(
    report: ImportReport, table: UserTable, ids: list[str], other: UserTable | None, meant: Recognised
) -> list[int]:
    """Row of joints of each point, by the pose's name or else row by row; -1, with a fault, where unknown."""
    if other is None:
        return list(range(len(table)))
    if "pose" in meant.columns:
        known = {name: i for i, name in enumerate(ids)}
        known |= {comparable_id(name): i for name, i in known.items()}
        column, out = meant.columns["pose"].name, []
        named = other.text(column)
        if not any(name in known or comparable_id(name) in known for name in named):
            report.fault(
                f"{other.path}: column {column}: none of its names ({named[0][:40]!r} ...) is a pose of {table.path} "
                f"({ids[0][:40]!r} ...); name the poses alike in both, or leave the column out by --map "
                f"'{column}=ignore' where the rows are in the same order"
            )
            return [-1] * len(other)
        for i, name in enumerate(named):
            row = known.get(name, known.get(comparable_id(name)))
            if row is None:
                line = other.lines[i]
                report.fault(f"{other.path}: line {line}, column {column}: pose {name[:40]!r} is not in {table.path}")
            out.append(-1 if row is None else row)
        return out
    if len(other) != len(table):
        report.fault(
            f"{other.path}: has {len(other)} rows and {table.path} {len(table)}, and no column tells the pose; add a "
            "column pose to both"
        )
        return [-1] * len(other)
    report.notes.append(f"{other.path}: no column names the pose; its rows are taken in the order of {table.path}")
    return list(range(len(table)))


def require_poses(report: ImportReport, table: UserTable, meant: Recognised, q: Array) -> None:
    """Report a fault where the rows are no poses but a recording whose time is not recognised."""
    pose = meant.columns.get("pose")
    is_named = pose is not None and (pose.why == AS_MAPPED or any(as_number(c) is None for c in table.text(pose.name)))
    if len(q) < _RECORDED or is_named or "time_s" in meant.columns:
        return
    extent = np.linalg.norm(np.ptp(q, axis=0))
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    if extent > 0.0 and np.nanquantile(steps, 0.9) < _SMALL_STEP * extent:
        report.fault(
            f"{table.path}: its {len(q)} rows are a recording, as the arm moves by little from one to the next, and "
            "no column is recognised as their time; tell it by --map COLUMN=time_s; where the rows are poses, name "
            "them by a column pose"
        )


def comparable_id(name: str) -> str:
    """A pose's name for comparison with another table's, where 7, 7.0 and 007 are equal, and P1 and p1."""
    try:
        value = float(name)
    except ValueError:
        return name.lower()
    return f"#{int(value)}" if abs(value) < 1e15 and value == int(value) else name


def point_of_each_pose(q_file: Array, seen: Array, row_of: Sequence[int]) -> Array:
    """One point (N, 3) for each pose; NaN where a pose has none."""
    out = np.full((len(q_file), 3), np.nan)
    rows = np.asarray(row_of, dtype=int)
    out[rows[rows >= 0]] = seen[rows >= 0]
    return out


def points_unit(
    report: ImportReport, table: UserTable, meant: Recognised, near: Array, q: Array
) -> tuple[str, str, float]:
    """Unit of the points, the reason, and the ratio of the points' spread to the arm's; "" and 1 for units in names.

    Taken from the columns' names, else from the points' spread relative to the arm's.
    near: (N, 3) in the file's unit, q: (N, n) rad, mm.
    """
    told = {meant.columns[axis].unit for axis in "xyz"}
    what = ", ".join(meant.columns[axis].name for axis in "xyz")
    if len(told) > 1:
        report.fault(f"{table.path}: line 1: columns {what} have different units")
        return "mm", "", 1.0
    unit = told.pop()
    if unit:
        report.notes.append(f"{table.path}: points are {what}, in {unit} by their names")
        return unit, "", 1.0
    assert report.robot is not None
    unit, off = length_unit(report.robot, q, near)
    how = f"taken for {unit}, in which they spread as the arm's tool does"
    report.notes.append(f"{table.path}: points are {what}, {how}")
    return unit, how, off


def require_near_spread(report: ImportReport, table: UserTable, meant: Recognised, unit: str, off: float) -> None:
    """Report a fault where points without a named unit spread very differently from the arm's tool in every unit."""
    if off > _FAR_SPREAD:
        what = ", ".join(meant.columns[axis].name for axis in "xyz")
        report.fault(
            f"{table.path}: line 1: {what} have no unit, and their spread is {off:.2g} times off the arm's in "
            f"{unit}; tell it by --map '{meant.columns['x'].name}=x_mm' (or x_m), and check joints and robot"
        )


def of_one_place(near: Array, row_of: Sequence[int], points: tuple[UserTable, Recognised], setups: list[str]) -> Array:
    """Points (N, 3) of the target and station with most points; NaN elsewhere."""
    table, meant = points
    out = near.copy()
    if "target" in meant.columns:
        targets = table.text(meant.columns["target"].name)
        most = Counter(targets).most_common(1)[0][0]
        first: dict[int, int] = {}
        for i, (row, target) in enumerate(zip(row_of, targets, strict=True)):
            if target == most and row >= 0:
                first.setdefault(row, i)
        xyz = np.column_stack([_coordinate(ImportReport(None), table, meant.columns[axis].name) for axis in "xyz"])
        out[:] = np.nan
        out[list(first)] = xyz[list(first.values())]
    if setups:
        most = Counter(setups).most_common(1)[0][0]
        out[[setup != most for setup in setups]] = np.nan
    return out
