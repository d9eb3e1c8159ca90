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
    is_exact,
    length_column,
    names_poses,
    numbered_joints,
    recognise,
)
from calib.dataset_import.place_columns import Triple, has_poses, own_pose_columns, point_groups
from calib.dataset_import.pose_names import SAME_NAMES, comparable_id, matched
from calib.dataset_import.units import length_unit, misfit_share
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.text_files.column_names import ANGLES_RAD, LENGTHS_MM, plain, split_unit
from calib.text_files.csv_text import as_number
from calib.text_files.user_table import Fault, RowFault, UserTable

_MOST_FAULTS = 20
_MOST_PLACES = 8  # that a fault lists
_MOST = 1e9  # degrees, micrometres
_MOST_DEG = 400.0  # of a joint
_FOLLOWS, _STANDS = 1e-3, 0.1  # of its range, by which a column may miss a sum of others; of the file's unit
_WHOLE = 0.01  # by which the shares of such a sum may miss whole numbers
_RECORDED = 300  # rows, from which a table may be a recording
_SMALL_STEP = 0.05  # of the whole motion, between two rows of a recording
_SAME_JOINT = 1e-3  # deg, rad, mm, up to which readings are of one pose
_CLEAR = 3.0  # ratio of misfits from which one reading of angles and distances is clearly the right one
_FAR_SPREAD = 2.0  # points spread by another factor than the arm's have a unit that cannot be told


@dataclass(frozen=True)
class LeftOutRow:
    """A row of a user's file that is no pose and no point of one: of a nest, a drift point, a mean, or limits."""

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

    def leave_out(self, table: UserTable, rows: Sequence[int], names: Sequence[str], why: str) -> str:
        """Add rows that are left out; their names in short."""
        pairs = zip(rows, names, strict=True)
        self.left_out += [LeftOutRow(table.path.name, table.lines[i], name, why) for i, name in pairs]
        return numbers.in_short([name[:40] or "one without a name" for name in names], _MOST_PLACES)

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


@dataclass(frozen=True)
class MeantTable:
    """A user's table with the meaning of its columns."""

    table: UserTable
    meant: Recognised

    @property
    def path(self) -> Path:
        """File of the table."""
        return self.table.path

    @property
    def has_points(self) -> bool:
        """Whether columns hold a point."""
        return all(axis in self.meant.columns for axis in "xyz")

    @property
    def length(self) -> Column | None:
        """Column of measured lengths; None where there is none."""
        return length_column(self.meant)

    @property
    def pose(self) -> str:
        """Column that names the poses; "" where there is none."""
        return self.named("pose")

    def named(self, meaning: str) -> str:
        """Name of the column of a meaning; "" where there is none."""
        column = self.meant.columns.get(meaning)
        return "" if column is None else column.name

    def cells(self, meaning: str) -> list[str]:
        """Cells of the column of a meaning; [] where there is none."""
        name = self.named(meaning)
        return self.table.text(name) if name else []

    def of_rows(self, kept: Sequence[int]) -> MeantTable:
        """Some rows of the table."""
        return replace(self, table=self.table.of_rows(kept))

    def with_columns(self, columns: Mapping[str, Column], rest: Sequence[str] | None = None) -> MeantTable:
        """The same table with other meanings; what they leave of its columns is the rest."""
        used = {column.name for column in columns.values()}
        rest = [name for name in (self.meant.rest if rest is None else rest) if name not in used]
        return replace(self, meant=Recognised(columns, tuple(rest), self.meant.faults))


def recognised(
    report: ImportReport, table: UserTable, mapping: Mapping[str, Meaning], *, positions: bool, joints: bool = True
) -> MeantTable:
    """Table with recognised columns; missing ones are reported as faults."""
    robot = report.robot
    by_place = None if table.has_header or robot is None else _by_place(report, table, robot.n_joints if joints else 0)
    unnamed = table.columns[0]
    if table.has_header and unnamed == "column 1":
        cells = table.text(unnamed)
        by_place = {unnamed: "pose"} if all(cells) and len(set(cells)) == len(cells) else None
    moving = moving_joints(table, robot) if joints and robot is not None and not mapping else []
    if moving:
        by_place = {name: f"q{k + 1}" for k, name in enumerate(moving)}
        report.notes.append(
            f"{table.path}: the {len(moving)} joints are {', '.join(moving)}: the other columns of joints stand still "
            "or follow these in all rows"
        )
    found = recognise(table.columns, robot, mapping, by_place)
    have = ", ".join(table.columns[:30])
    wrong = list(found.faults)
    if joints and robot is not None and not found.faults:
        n = robot.n_joints
        missing = [f"q{k + 1}" for k in range(n) if f"q{k + 1}" not in found.columns]
        if len(missing) == n and has_poses(table):
            wrong.append(
                f"its columns are Cartesian poses ({have}), and the joints' values are needed: poses do not tell by "
                "which of several ways the arm reached them, nor what its table made of the joints; controllers and "
                "ROS (/joint_states) log these beside them. Where a camera saw a board at them, --images or "
                "--marker-poses finds the camera's place without"
            )
        elif missing and not table.has_header:
            wrong.append(
                f"no names stand above its {len(table.columns)} columns; {n} are taken for the joints, {n + 3} for "
                "joints and x, y, z, each with the pose's name in front or not; write a line of names above them, "
                "such as pose,q1,q2"
            )
        elif missing:
            wrong.append(
                f"{n} columns of joints are needed, q1 to q{n} or the joints' names; found {have}; tell with --map "
                f"{_numbered(table.columns, n)}"
            )
    unfound = [axis for axis in "xyz" if axis not in found.columns]
    if positions and not joints and length_column(found) is None and unfound:
        wrong.append(f"no column for {', '.join(unfound)}{_several(table)}; found {have}; tell with --map column=x")
    report.faults += [f"{table.path}: line 1: {words}" for words in wrong]
    return MeantTable(table, found)


def _by_place(report: ImportReport, table: UserTable, n_joints: int) -> dict[str, str] | None:
    """Meanings of columns without names by their number, the pose's name in front or not; None where it is another.

    n_joints: 0 for a table of points.
    """
    joints, point = [f"q{k + 1}" for k in range(n_joints)], ["x", "y", "z"]
    forms = [
        [*first, *each] for first in ([], ["pose"]) for each in ((joints, [*joints, *point]) if joints else (point,))
    ]
    meanings = next((form for form in forms if len(form) == len(table.columns)), None)
    columns = table.columns
    if meanings is None and not joints:
        columns = tuple(n for n in columns if all(as_number(cell) is not None for cell in table.text(n) if cell))
        meanings = point if len(columns) == len(point) else None
    if meanings is None:
        return None
    start = meanings.index(joints[0]) if joints else 0
    if joints and meanings[-1] == "z" and _has_points_first(table, start):
        meanings = [*meanings[:start], *point, *joints]
    report.notes.append(f"{table.path}: has no header; its columns are taken for {', '.join(meanings)}")
    return dict(zip(columns, meanings, strict=True))


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
    own = own_pose_columns(table.columns)
    if len(groups) < 2 and own is None:
        return ""
    first = next(iter(groups.values()), own)
    assert first is not None
    typed = " ".join(f"--map '{name}={axis}'" for name, axis in zip(first, "xyz", strict=True))
    if len(groups) < 2:
        return f"; {first[0]} ... are named as the pose that a controller computes; if measured, say so by {typed}"
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


def joint_values(report: ImportReport, joints: MeantTable) -> Array | None:
    """Joint values (N, n) in the file's units; None, with a fault, where columns or units of theirs are wrong."""
    columns = joints.meant.columns
    if report.robot is None:  # its cells are judged all the same
        for meaning, column in columns.items():
            if quantity_of(meaning) == "q":
                coordinates(report, joints.table, [column.name], may_be_empty=False)
        return None
    names = [f"q{k + 1}" for k in range(report.robot.n_joints)]
    if not all(name in columns for name in names):
        return None
    count = len(report.faults)
    for k, (name, joint) in enumerate(zip(names, report.robot.joints, strict=True)):
        unit = columns[name].unit
        if unit and unit not in (ANGLES_RAD if joint.is_revolute else LENGTHS_MM):
            report.fault(
                f"{joints.path}: line 1, column {columns[name].name}: {unit} is no unit of joint {k + 1} "
                f"({joint.name}), which is {joint.type}; say what it "
                f"is by --map '{columns[name].name}={name}_{'deg' if joint.is_revolute else 'mm'}'"
            )
    if len(report.faults) > count:
        return None
    return coordinates(report, joints.table, [*map(joints.named, names)], may_be_empty=False)


def point_values(report: ImportReport, points: MeantTable, *, needed: bool) -> Array | None:
    """Points (M, 3) in the file's unit; None where there are none."""
    table, columns = points.table, points.meant.columns
    if not points.has_points:
        some = [axis for axis in "xyz" if axis in columns]
        if needed and some and points.length is None:
            missing = " and ".join(axis for axis in "xyz" if axis not in some)
            report.fault(
                f"{table.path}: line 1: no column for {missing} beside {', '.join(map(points.named, some))}; found "
                f"{', '.join(table.columns[:30])}; tell with --map column={missing[0]}"
            )
        is_told = any(str(fault).startswith(f"{table.path}: line 1: no ") for fault in report.faults)
        if needed and not is_told and points.length is None and not any(axis in columns for axis in "xyz"):
            report.fault(
                f"{table.path}: line 1: no columns x, y, z{_several(table)}; give --points FILE.csv, --scans FOLDER or "
                "--map column=x"
            )
        return None
    found = coordinates(report, table, [*map(points.named, "xyz")])
    blank = np.array([[not cell for cell in points.cells(axis)] for axis in "xyz"]).T
    for i in np.flatnonzero(blank.any(axis=1) & ~blank.all(axis=1)):
        named = " and ".join(columns["xyz"[k]].name for k in np.flatnonzero(blank[i]))
        report.fault(table.fault(int(i), f"{named} is empty; fill it in, or leave all three empty"))
    return found


def coordinates(report: ImportReport, table: UserTable, names: Sequence[str], *, may_be_empty: bool = True) -> Array:
    """Numbers (rows, columns) of columns; NaN for an empty cell, a point that was not measured, and for a fault.

    A fault is a cell without a number or with one beyond any arm.
    """
    values = np.column_stack([table.numbers(name, report.fault, may_be_empty=may_be_empty) for name in names])
    for k, i in np.argwhere(np.abs(values.T) > _MOST).tolist():
        report.fault(table.fault(i, f"found {values[i, k]:g}, which is far too large", names[k]))
    return np.where(np.abs(values) > _MOST, np.nan, values)


def pose_ids(report: ImportReport, joints: MeantTable) -> list[str]:
    """Pose names of the rows of joints: from the table, else p1, p2, ..."""
    table = joints.table
    if not joints.pose:
        return [f"p{table.position(i) + 1}" for i in range(len(table))]
    ids = joints.cells("pose")
    first: dict[str, int] = {}
    for i, name in enumerate(ids):
        if not name:
            report.fault(table.fault(i, "the cell is empty", joints.pose))
        elif first.setdefault(name, i) != i:
            where = f"{table.path}: line {table.lines[i]}: pose {name!r} stands in line {table.lines[first[name]]} too"
            report.fault(f"{where}, at other joint values; each needs its own")
    return ids


def parted(report: ImportReport, joints: MeantTable) -> tuple[MeantTable, MeantTable | None]:
    """Table of a row a pose, and one of the points, where a table has several readings or targets of a pose in rows.

    Rows of one pose have the same joint values, or have these and the pose's name in the first row alone.
    """
    table, columns = joints.table, joints.meant.columns
    values = [column.name for meaning, column in columns.items() if quantity_of(meaning) == "q"]
    if not values or not joints.has_points or not joints.pose:
        return joints, None
    at, where = table.columns.index(joints.pose), [table.columns.index(name) for name in values]
    first: dict[str, int] = {}
    rows, name = [], ""
    for i, row in enumerate(table.rows):
        own = [row[k] for k in where]
        name = row[at] if row[at] or any(own) else name
        start = first.setdefault(name, i)
        if start != i and any(own) and not _are_equal(own, [table.rows[start][k] for k in where]):
            return joints, None
        rows.append((*row[:at], name, *row[at + 1 :]))
    if len(first) == len(table) or "" in first:
        return joints, None
    every = replace(table, rows=tuple(rows), path=table.path.with_name(f"{table.path.name} (points)"))
    report.notes.append(f"{table.path}: {len(table)} rows are readings at {len(first)} poses")
    of_point = {key: column for key, column in columns.items() if key in ("pose", "target", *"xyz") or is_exact(key)}
    of_pose = {key: column for key, column in columns.items() if key == "pose" or key not in of_point}
    rest = [*joints.meant.rest]
    return (
        joints.of_rows(list(first.values())).with_columns(of_pose, rest),
        MeantTable(every, joints.meant).with_columns(of_point, ()),
    )


def _are_equal(cells: Sequence[str], others: Sequence[str]) -> bool:
    """Whether joint values are the same, but for a controller's last digits."""
    pairs = [(as_number(a), as_number(b)) for a, b in zip(cells, others, strict=True)]
    return all(a is not None and b is not None and abs(a - b) <= _SAME_JOINT for a, b in pairs)


def named_by_values(report: ImportReport, joints: MeantTable, points: MeantTable) -> tuple[MeantTable, MeantTable]:
    """The tables with the columns that name the poses, found by the values that both have.

    Whatever two columns are called: where at least half of the points have a name that stands once in a column of the
    joints, that column names the poses. One that merely counts the rows gives way to another. What the user maps stays.
    A target that is the same in all rows and none of the robot's is the kind of the reflector.
    """
    is_told = any(one.pose and one.meant.columns["pose"].why == AS_MAPPED for one in (joints, points))
    ids = [] if joints.pose or is_told else pose_ids(report, joints)
    best, pair = (False, False, 0.0), None
    for name in () if is_told else (*_possible_names(joints), *([""] if ids else [])):
        cells = joints.table.text(name) if name else ids
        if len(set(map(comparable_id, cells))) < len(cells):
            continue
        for of_point in _possible_names(points):
            names = points.table.text(of_point)
            found = matched(names, cells)
            is_same, by_words = found.how in SAME_NAMES, any(comparable_id(each)[:1] != "#" for each in names)
            by_header = (not name or _may_name(joints, name)) and _may_name(points, of_point)
            if min(found.count - 2, 2 * found.count - len(names)) < 0 or not (by_header or (is_same and by_words)):
                continue
            is_known = bool(name) and points.pose == of_point and joints.pose == name
            score = (not _counts_rows(names), is_same, found.count + 0.5 * is_known)
            if pair is None or score > best:
                best, pair = score, (name, of_point)
    if pair is not None:
        joints = _with_pose(joints, pair[0], points) if pair[0] else joints
        points = _with_pose(points, pair[1], joints)
    kinds = set(points.cells("target"))
    known = {"jig"} | ({each.name for each in report.robot.targets} if report.robot is not None else set())
    if len(kinds) == 1 and not kinds <= known:
        name = points.named("target")
        report.notes.append(f"{points.path}: column {name} is {kinds.pop()!r} in all rows and left out")
        columns = {key: column for key, column in points.meant.columns.items() if key != "target"}
        points = points.with_columns(columns, [*points.meant.rest, name])
    return joints, points


def _counts_rows(names: Sequence[str]) -> bool:
    """Whether names are the numbers of the rows, which say nothing of them."""
    return any([comparable_id(name) for name in names] == [f"#{i + k}" for i in range(len(names))] for k in (0, 1))


def _may_name(table: MeantTable, name: str) -> bool:
    return name == table.pose or names_poses(name)


def _possible_names(table: MeantTable) -> list[str]:
    """Columns that may name poses: the recognised one first, then a target's, then those of no meaning."""
    return [*filter(None, (table.pose, table.named("target"))), *table.meant.rest]


def _with_pose(one: MeantTable, name: str, other: MeantTable) -> MeantTable:
    """The table with a column that names the poses, as its values stand in another table."""
    if one.pose == name:
        return one
    columns = {key: column for key, column in one.meant.columns.items() if key != "pose" and column.name != name}
    columns["pose"] = Column(name, "pose", why=f"its values name the rows of {other.path.name}")
    return one.with_columns(columns, [*one.meant.rest, *([one.pose] if one.pose else [])])


def named_places(report: ImportReport, joints: MeantTable, places: UserTable) -> UserTable | None:
    """Table with a point a pose, where the joints' table names in each row which of some known places was visited.

    A place is a row of `places`, such as a socket of a plate; both tables have a column of one name for it. None where
    they have none; a place that is not listed is a fault.
    """
    free = {plain(split_unit(name)[0]): name for name in joints.meant.rest}
    for name in places.columns:
        of_visit, listed = free.get(plain(split_unit(name)[0])), places.text(name)
        if of_visit is None or len(set(listed)) != len(listed) or "" in listed:
            continue
        row_of = {place: i for i, place in enumerate(listed)}
        visited = joints.table.text(of_visit)
        if not set(visited) & set(row_of) or len(set(visited)) == len(visited):  # each once: names of poses
            continue
        rows, lines = [], []
        for k, (pose, place) in enumerate(zip(pose_ids(ImportReport(None), joints), visited, strict=True)):
            if place in row_of:
                rows.append((pose, *places.rows[row_of[place]]))
                lines.append(places.lines[row_of[place]])
            elif place:
                known = numbers.in_short(listed, _MOST_PLACES)
                report.fault(joints.table.fault(k, f"{place[:40]!r} is not in {places.path} ({known})", of_visit))
        report.notes.append(
            f"{places.path}: column {name} names the places that {joints.path.name} visits: {len(rows)} visits of "
            f"{len(set(visited) & set(row_of))} places"
        )
        return UserTable(places.path, ("pose", *places.columns), tuple(rows), tuple(lines), has_header=True)
    return None


def placement_columns(joints: MeantTable, points: MeantTable | None) -> list[str]:
    """Unrecognised columns of words, each several times: they may name where the instrument or a plate stood.

    points: whose columns are something else
    """
    if "setup" in joints.meant.columns:
        return []
    found, others = [], () if points is None else tuple(map(plain, points.table.columns))
    for name in joints.meant.rest:
        if plain(name) in others:
            continue
        cells = joints.table.text(name)
        words = Counter(cell for cell in cells if as_number(cell) is None)
        if len(words) > 1 and sum(words.values()) == len(cells) and min(words.values()) > 1:
            found.append(name)
    return found


def rows_of_points(
    report: ImportReport, joints: MeantTable, ids: Sequence[str], points: MeantTable
) -> tuple[MeantTable, list[int]]:
    """Table of the points that belong to poses, and the row of joints of each; -1, with a fault, where it is unknown.

    By the poses' names, else row by row. Points that belong to no pose are left out and told, unless they are most.
    """
    table, none = points.table, [-1] * len(points.table)
    if not points.pose:
        if len(table) != len(ids):
            report.fault(
                f"{table.path}: has {len(table)} rows and {joints.path} {len(ids)}, and no column tells the pose; add "
                "a column pose to both"
            )
            return points, none
        report.notes.append(f"{table.path}: no column names the pose; its rows are taken in the order of {joints.path}")
        return points, list(range(len(ids)))
    names = points.cells("pose")
    found = matched(names, ids)
    strange = [i for i, row in enumerate(found.pose) if row < 0]
    if 2 * len(strange) > len(table):
        told = numbers.in_short([repr(names[i][:40]) for i in strange], _MOST_PLACES)
        report.fault(
            f"{table.path}: column {points.pose}: {len(strange)} of {len(table)} names ({told}) are no poses of "
            f"{joints.path} ({ids[0][:40]!r} ...); name the poses alike in both, or leave the column out by --map "
            f"'{points.pose}=ignore' where the rows are in the same order"
        )
        return points, list(found.pose)
    if found.how:
        report.notes.append(f"{table.path}: points are matched to the poses of {joints.path.name} {found.how}")
    if strange:
        why = f"its name is no pose of {joints.path.name}"
        told = report.leave_out(table, strange, [names[i] for i in strange], why)
        belong = (
            "1 point belongs to no pose and is"
            if len(strange) == 1
            else (f"{len(strange)} points belong to no pose and are")
        )
        report.notes.append(f"{table.path}: {belong} left out: {told}")
    kept = [i for i, row in enumerate(found.pose) if row >= 0]
    return points.of_rows(kept), [found.pose[i] for i in kept]


def require_poses(report: ImportReport, joints: MeantTable, q: Array) -> None:
    """Report a fault where the rows are no poses but a recording whose time is not recognised."""
    pose = joints.meant.columns.get("pose")
    is_named = pose is not None and (pose.why == AS_MAPPED or any(as_number(c) is None for c in joints.cells("pose")))
    if len(q) < _RECORDED or is_named or "time_s" in joints.meant.columns:
        return
    extent = np.linalg.norm(np.ptp(q, axis=0))
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    if extent > 0.0 and np.nanquantile(steps, 0.9) < _SMALL_STEP * extent:
        report.fault(
            f"{joints.path}: its {len(q)} rows are a recording, as the arm moves by little from one to the next, and "
            "no column is recognised as their time; tell it by --map COLUMN=time_s; where the rows are poses, name "
            "them by a column pose"
        )


def point_of_each_pose(count: int, seen: Array, row_of: Sequence[int]) -> Array:
    """One point (N, 3) for each pose, its first; NaN where a pose has none."""
    out = np.full((count, 3), np.nan)
    rows = np.asarray(row_of, dtype=int)[::-1]
    out[rows[rows >= 0]] = seen[::-1][rows >= 0]
    return out


def with_clear_reading(
    report: ImportReport, points: MeantTable, readings: Sequence[Triple], q: Array, row_of: Sequence[int]
) -> MeantTable:
    """Table of points with the columns of that reading of angles and distances which the arm meets.

    q: (N, n) rad, mm. A fault is reported where no reading stands out.
    """
    assert report.robot is not None
    shares = []
    for names in readings:
        seen = points.table.known(names)
        shares.append(misfit_share(report.robot, q, point_of_each_pose(len(q), seen, row_of)))
    best, second, *_ = np.argsort(shares)
    if not shares[second] > _CLEAR * shares[best]:
        report.fault(
            f"{points.path}: its angles and distances may be meant in several ways, and the arm does not tell which; "
            "export x, y, z"
        )
    columns = dict(points.meant.columns)
    columns |= {axis: replace(columns[axis], name=name) for axis, name in zip("xyz", readings[best], strict=True)}
    every = {name for names in readings for name in names}
    return points.with_columns(columns, [name for name in points.meant.rest if name not in every])


def points_unit(report: ImportReport, points: MeantTable, near: Array, q: Array) -> tuple[str, str, float]:
    """Unit of the points, the reason, and the ratio of the points' spread to the arm's; "" and 1 for units in names.

    A unit of "" is one that is told in several ways, with a fault.

    Taken from the columns' names, else from the points' spread relative to the arm's.
    near: (N, 3) in the file's unit, q: (N, n) rad, mm.
    """
    told = {points.meant.columns[axis].unit for axis in "xyz"}
    told = told - {""} or told  # one that is told is that of all
    what = ", ".join(map(points.named, "xyz"))
    if len(told) > 1:
        usual = Counter(points.meant.columns[axis].unit for axis in "xyz").most_common(1)[0][0]
        typed = " ".join(f"--map '{points.named(axis)}={axis}_{usual}'" for axis in "xyz")
        report.fault(
            f"{points.path}: line 1: columns {what} have different units; write them in one, or, where the "
            f"names are wrong, say so by {typed}"
        )
        return "", "", 1.0
    unit = told.pop()
    if unit:
        report.notes.append(f"{points.path}: points are {what}, in {unit} by their names")
        return unit, "", 1.0
    assert report.robot is not None
    known = near[np.isfinite(near).all(axis=1)]
    if len(known) > 1 and not np.ptp(known, axis=0).any():
        raise DatasetError(
            f"{points.path}: {what} are the same at all {len(known)} poses: nothing can be learned from them; "
            f"measure the point anew at each, or, where one place was visited, tell its unit by --map "
            f"'{points.named('x')}=x_mm'"
        )
    unit, off = length_unit(report.robot, q, near)
    how = f"taken for {unit}, in which they spread as the arm's tool does"
    report.notes.append(f"{points.path}: points are {what}, {how}")
    return unit, how, off


def require_near_spread(report: ImportReport, points: MeantTable, unit: str, off: float) -> None:
    """Report a fault where points without a named unit spread very differently from the arm's tool in every unit."""
    if off > _FAR_SPREAD:
        report.fault(
            f"{points.path}: line 1: {', '.join(map(points.named, 'xyz'))} have no unit, and their spread is {off:.2g} "
            f"times off the arm's in {unit}; tell it by --map '{points.named('x')}=x_mm' (or x_m), and check joints "
            "and robot"
        )


def of_one_place(
    near: Array, seen: Array, row_of: Sequence[int], targets: Sequence[str], setups: Sequence[str]
) -> Array:
    """Points (N, 3) of the target and station with most points; NaN elsewhere.

    Args:
        near: (N, 3) one point of each pose.
        seen: (M, 3) all points.
        row_of: row of joints of each point.
        targets: target of each point, [] for one.
        setups: setup of each pose, [] for one.
    """
    out = near.copy()
    if targets:
        most = Counter(targets).most_common(1)[0][0]
        of_most = [i for i, target in enumerate(targets) if target == most]
        out = point_of_each_pose(len(near), seen[of_most], [row_of[i] for i in of_most])
    if setups:
        most = Counter(setups).most_common(1)[0][0]
        out[[setup != most for setup in setups]] = np.nan
    return out
