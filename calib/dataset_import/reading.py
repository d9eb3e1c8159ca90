"""What a user's tables say: columns, joint values, points, which point belongs to which pose; faults are collected."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib.array_types import Array
from calib.dataset_import.columns import Recognised, recognise
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, length_unit
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.user_tables.user_table import UserTable

_MOST_FAULTS = 20
_FAR_SPREAD = 2.0  # points spread by another factor than the arm's have a unit that cannot be told


@dataclass
class Work:
    """What is found out on the way."""

    robot: Robot
    faults: list[str] = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    def fault(self, words: str) -> None:
        """One more."""
        self.faults.append(words)

    def raise_all(self) -> None:
        """Raise DatasetError with all faults so far."""
        if not self.faults:
            return
        shown = self.faults[:_MOST_FAULTS]
        if len(self.faults) == 1:
            raise DatasetError(shown[0])
        more = [f"... and {len(self.faults) - len(shown)} more"] if len(self.faults) > len(shown) else []
        raise DatasetError("\n  ".join([f"nothing was written, {len(self.faults)} faults:", *shown, *more]))


def recognised(
    work: Work, table: UserTable, mapping: dict[str, tuple[str, str]], *, positions: bool, joints: bool = True
) -> Recognised:
    """The columns of a table; what it needs and does not have becomes a fault."""
    robot = work.robot
    if not table.has_header:
        wanted = [f"q{k + 1}" for k in range(robot.n_joints)] if joints else []
        for extra in ([], ["x", "y", "z"]) if joints else (["x", "y", "z"],):
            for first in ([], ["pose"]):
                if len(table.columns) == len(first + wanted + extra):
                    meanings = first + wanted + extra
                    mapping = {c: (m, "") for c, m in zip(table.columns, meanings, strict=True)} | mapping
                    work.said.append(
                        f"{table.path}: has no header; its columns are taken for {', '.join(meanings)}"
                    )
    found = recognise(table.columns, robot, mapping)
    for words in found.faults:
        work.fault(f"{table.path}: line 1: {words}")
    have = ", ".join(table.columns[:30])
    if joints and not found.faults:
        missing = [f"q{k + 1}" for k in range(robot.n_joints) if f"q{k + 1}" not in found.columns]
        if missing:
            work.fault(
                f"{table.path}: line 1: {robot.n_joints} columns of joints are needed, q1 to q{robot.n_joints} or the "
                f"joints' names; found {have}; tell with --map column=q1"
            )
    if positions and not joints:
        missing = [axis for axis in "xyz" if axis not in found.columns]
        if missing:
            work.fault(
                f"{table.path}: line 1: no column for {', '.join(missing)}; found {have}; tell with --map column=x"
            )
    return found


def joint_values(work: Work, table: UserTable, meant: Recognised) -> Array | None:
    """(N, n) as they stand in the file."""
    names = [f"q{k + 1}" for k in range(work.robot.n_joints)]
    if not all(name in meant.columns for name in names):
        return None
    for k, (name, joint) in enumerate(zip(names, work.robot.joints, strict=True)):
        unit = meant.columns[name].unit
        if unit and unit not in (ANGLES_RAD if joint.is_revolute else LENGTHS_MM):
            work.fault(
                f"{table.path}: line 1, column {meant.columns[name].name}: {unit} is no unit of joint {k + 1} "
                f"({joint.name}), which is {joint.type}"
            )
    return np.column_stack([table.numbers(meant.columns[name].name, work.fault) for name in names])


def point_values(work: Work, table: UserTable, meant: Recognised, *, needed: bool) -> Array | None:
    """(M, 3) as they stand in the file; None where there are none."""
    if not all(axis in meant.columns for axis in "xyz"):
        if needed and not any(axis in meant.columns for axis in "xyz") and not work.faults:
            work.fault(
                f"{table.path}: line 1: no columns x, y, z; give --points FILE.csv, --scans FOLDER or --map column=x"
            )
        return None
    return np.column_stack([_coordinate(work, table, meant.columns[axis].name) for axis in "xyz"])


def _coordinate(work: Work, table: UserTable, name: str) -> Array:
    """A column of coordinates; an empty cell is a point that was not measured."""
    blank = [not cell for cell in table.text(name)]
    if not any(blank):
        return table.numbers(name, work.fault)
    filled = replace(table, rows=tuple(tuple(cell or "0" for cell in row) for row in table.rows))
    return np.where(blank, np.nan, filled.numbers(name, work.fault))


def pose_ids(work: Work, table: UserTable, meant: Recognised) -> list[str]:
    """A name for each row of joints: those of the table, else p1, p2, ..."""
    if "pose" not in meant.columns:
        return [f"p{i + 1}" for i in range(len(table))]
    ids = table.text(meant.columns["pose"].name)
    first: dict[str, int] = {}
    for i, name in enumerate(ids):
        if not name:
            work.fault(
                f"{table.path}: line {table.lines[i]}, column {meant.columns['pose'].name}: the cell is empty"
            )
        elif first.setdefault(name, i) != i:
            line = table.lines[first[name]]
            work.fault(
                f"{table.path}: line {table.lines[i]}: pose {name!r} stands in line {line} too; each needs its own"
            )
    return ids


def rows_of_points(
    work: Work, table: UserTable, ids: list[str], other: UserTable | None, meant: Recognised
) -> list[int]:
    """Which row of joints each point belongs to: by the pose's name, else row by row."""
    if other is None:
        return list(range(len(table)))
    if "pose" in meant.columns:
        known = {name: i for i, name in enumerate(ids)}
        known |= {_number_of(name): i for name, i in known.items() if _number_of(name)}
        column, out = meant.columns["pose"].name, []
        for i, name in enumerate(other.text(column)):
            row = known.get(name, known.get(_number_of(name)))
            if row is None:
                line = other.lines[i]
                work.fault(
                    f"{other.path}: line {line}, column {column}: pose {name[:40]!r} is not in {table.path}"
                )
            out.append(row or 0)
        return out
    if len(other) != len(table):
        work.fault(
            f"{other.path}: has {len(other)} rows and {table.path} {len(table)}, and no column tells the pose; add a "
            "column pose to both"
        )
        return [0] * len(other)
    work.said.append(
        f"{other.path}: no column tells the pose; its rows are taken for those of {table.path}, in order"
    )
    return list(range(len(table)))


def _number_of(name: str) -> str:
    """A pose's name that is a whole number as such, so that 7, 7.0 and 007 are one; "" for others."""
    try:
        value = float(name)
    except ValueError:
        return ""
    return f"#{int(value)}" if abs(value) < 1e15 and value == int(value) else ""


def beside(q_file: Array, seen: Array, row_of: list[int]) -> Array:
    """(N, 3) a point of each pose, NaN where it has none."""
    out = np.full((len(q_file), 3), np.nan)
    out[row_of] = seen
    return out


def points_scale(
    work: Work, table: UserTable, meant: Recognised, robot: Robot, q: Array, seen: Array, row_of: list[int]
) -> float:
    """How many mm one unit of the points is: by their names, else by how far they are spread against the arm's."""
    told = {meant.columns[axis].unit for axis in "xyz"}
    what = ", ".join(meant.columns[axis].name for axis in "xyz")
    if len(told) > 1:
        work.fault(f"{table.path}: line 1: columns {what} have different units")
        return 1.0
    unit = told.pop()
    if unit:
        work.said.append(f"{table.path}: points are {what}, in {unit} by their names")
        return LENGTHS_MM[unit]
    unit, off = length_unit(robot, q[row_of], seen)
    work.said.append(
        f"{table.path}: points are {what}, taken for {unit}, in which they spread as the arm's tool does"
    )
    if off > _FAR_SPREAD:
        work.fault(
            f"{table.path}: line 1: {what} have no unit, and their spread is {off:.2g} times off the arm's in "
            f"{unit}; tell it by --map '{meant.columns['x'].name}=x_mm' (or x_m), and check joints and robot"
        )
    return LENGTHS_MM[unit]
