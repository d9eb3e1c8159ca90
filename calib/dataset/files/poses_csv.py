"""poses.csv, read, checked and written: one row per pose, angles in degrees unless the columns' names say rad."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import ROLES, Poses
from calib.dataset.files.csv_table import TableFile, short
from calib.dataset.files.declared_units import NOT_DECLARED, DeclaredUnits, internal, unit_of
from calib.dataset.input_names import CONDITIONS
from calib.dataset.signals import is_signal, limit_of
from calib.errors import DatasetError, is_one_line
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.text_files.toml_table import degrees

_JOINT_LIMITS = {"deg": (-1e5, 1e5), "mm": (-1e6, 1e6), "rad": (-1e4, 1e4), "m": (-1e3, 1e3)}
_LOOKS_LIKE_DEGREES = 20.0  # rad: no joint turns farther


def joint_columns(robot: Robot, angle: str = "deg", length: str = "mm") -> list[str]:
    """Names of the columns of a joint vector: q1_deg ..., q3_mm for a prismatic joint."""
    return [f"q{i + 1}_{angle if joint.is_revolute else length}" for i, joint in enumerate(robot.joints)]


def found_joint_columns(file: TableFile, robot: Robot, units: DeclaredUnits = NOT_DECLARED) -> list[str]:
    """Names of the joints' columns as a table has them. Raises DatasetError where units are mixed."""
    turns = list(robot.is_revolute)

    def of(names: list[str], revolute: bool) -> list[str]:
        return [name for name, turning in zip(names, turns, strict=True) if turning == revolute]

    angles = {unit: of(joint_columns(robot, angle=unit), True) for unit in ("deg", "rad")}
    lengths = {unit: of(joint_columns(robot, length=unit), False) for unit in ("mm", "m")}
    return joint_columns(
        robot,
        unit_of(file, angles, units.angle if any(turns) else ""),
        unit_of(file, lengths, units.length if not all(turns) else ""),
    )


def load_joints(file: TableFile, columns: list[str]) -> Array:
    """Joint values (N, n) as they are in the file, in the units of the columns' names. Raises DatasetError."""
    file.require(columns)
    return np.column_stack([_within(file, column, _JOINT_LIMITS[column.rpartition("_")[2]]) for column in columns])


def _within(file: TableFile, column: str, limits: tuple[float, float]) -> Array:
    """Numbers (N,) of a column. Raises DatasetError where one is outside the limits."""
    values = file.numbers([column])[:, 0]
    beyond = np.flatnonzero((values < limits[0]) | (values > limits[1]))
    if len(beyond):
        row = int(beyond[0])
        found = f"found {values[row]:g}, beyond {limits[0]:g} to {limits[1]:g}"
        raise file.error(row, column, found, "correct it; the unit stands in the column's name")
    return values


def load_poses(
    path: Path, robot: Robot, units: DeclaredUnits = NOT_DECLARED, *, growing: bool = False
) -> tuple[Poses, list[str]]:
    """The poses, and warnings about suspicious values; of a `growing` file its whole lines. Raises DatasetError."""
    file = TableFile.load(path, growing=growing)
    q_columns = found_joint_columns(file, robot, units)
    file.require(["pose", "role", *q_columns])
    if len(file) == 0:
        raise DatasetError(f"{path}: no row below the header; one row a pose is needed")
    ids = names(file, "pose")
    first: dict[str, int] = {}
    for row, pose_id in enumerate(ids):
        if first.setdefault(pose_id, row) != row:
            line = file.line(first[pose_id])
            raise file.error(row, "pose", f"{short(pose_id)} stands in line {line} too", "each pose needs its own id")
    role = file.choices("role", ROLES)
    references = [row for row, value in enumerate(role) if value == "reference"]
    if len(references) != 1:
        where = ", ".join(f"line {file.line(row)}" for row in references) or "none"
        raise DatasetError(f"{path}: column role: found {len(references)} reference poses ({where}); set exactly one")
    commanded = load_joints(file, q_columns)
    q = robot.joints_of(internal(commanded, q_columns))
    warnings = [*_angle_warnings(file, commanded, q, q_columns, robot)]
    conditions = load_conditions(file, robot)
    for column in filter(is_signal, file.cells):
        limit = limit_of(column) or 0.0
        _within(file, column, (-limit, limit))
    known = ["pose", "role", *q_columns, *CONDITIONS, "setup", "scan", *approach_columns(robot)]
    poses = Poses(
        ids=tuple(ids),
        role=np.array(role),
        q=q,
        setup=np.array(names(file, "setup", allow_empty=True) if "setup" in file else [""] * len(ids)),
        scan_names=tuple(names(file, "scan") if "scan" in file else [f"{pose_id}.ply" for pose_id in ids]),
        extra=file.rest(known),
        selected_from=None,
        **conditions,
    )
    return poses, warnings


def names(file: TableFile, column: str, *, allow_empty: bool = False) -> list[str]:
    """A column of names without control characters. Raises DatasetError."""
    found = file.text(column, allow_empty=allow_empty)
    for row, name in enumerate(found):
        if not is_one_line(name):
            raise file.error(row, column, f"found {short(name)}", "a name is one line without control characters")
    return found


def approach_columns(robot: Robot) -> list[str]:
    """Names of the columns with the direction (-1, 0, 1) from which each joint came: approach1 ..."""
    return [f"approach{i + 1}" for i in range(robot.n_joints)]


def load_conditions(file: TableFile, robot: Robot) -> dict[str, Array]:
    """Payload, temperature, time and approach of the poses, by field of `Poses`, for the columns that a table has."""
    conditions = {name: _within(file, name, limits) for name, limits in CONDITIONS.items() if name in file}
    columns = approach_columns(robot)
    if any(column in file for column in columns):
        file.require(columns)
        conditions["approach"] = file.numbers(columns)
        wrong = np.argwhere(~np.isin(conditions["approach"], (-1.0, 1.0)))
        if len(wrong):
            row, k = map(int, wrong[0])
            raise file.error(row, columns[k], f"found {conditions['approach'][row, k]:g}", "expected -1 or 1")
    return conditions


def in_unit_of(column: str, value: float) -> float:
    """A joint's value converted from rad or mm to the unit that its column's name ends with."""
    if column.endswith("_deg"):
        return math.degrees(value)
    return value / 1000.0 if column.endswith("_m") else value


def _angle_warnings(file: TableFile, q_file: Array, q: Array, columns: list[str], robot: Robot) -> list[str]:
    """Warnings on angles that look like another unit and on joint values q (N, n) beyond the joints' limits."""
    turning = robot.is_revolute
    warnings = []
    if turning.any():
        largest = float(np.abs(q_file[:, turning]).max())
        spans = [j.max - j.min for j in robot.joints if j.is_revolute and j.min is not None and j.max is not None]
        wide = not spans or max(spans) > math.radians(30.0)
        in_rad = any(name.endswith("_rad") for name in columns)
        if in_rad and largest > _LOOKS_LIKE_DEGREES:
            warnings.append(
                f"{file.path}: the largest joint angle is {largest:.4g} rad; these look like degrees, not radians"
            )
        if not in_rad and wide and 0.0 < largest < 6.4:
            warnings.append(
                f"{file.path}: every joint angle is below 6.4 (largest {largest:.3g}); "
                "these look like radians, not degrees"
            )
    for i, joint in enumerate(robot.joints):
        low, high = (bound if v is None else v for v, bound in ((joint.min, -np.inf), (joint.max, np.inf)))
        beyond = (q[:, i] < low - 1e-9) | (q[:, i] > high + 1e-9)
        if beyond.any():
            row = int(np.flatnonzero(beyond)[0])
            warnings.append(
                f"{file.path}: {int(beyond.sum())} poses lie beyond the limits of {joint.name}, the first in line "
                f"{file.line(row)} ({in_unit_of(columns[i], float(q[row, i])):g})"
            )
    return warnings


def poses_frame(poses: Poses, robot: Robot) -> pd.DataFrame:
    """The columns of poses.csv: commanded joint values, angles in degrees, and the conditions."""
    columns: dict[str, Any] = {"pose": poses.ids, "role": poses.role}
    if any(poses.setup):
        columns["setup"] = poses.setup
    commanded = robot.commands_of(poses.q)
    for k, (name, joint) in enumerate(zip(joint_columns(robot), robot.joints, strict=True)):
        columns[name] = [degrees(v) for v in commanded[:, k]] if joint.is_revolute else commanded[:, k]
    for name in CONDITIONS:
        values = getattr(poses, name)
        if values is not None:
            columns[name] = values
    if poses.approach is not None:
        columns |= {name: poses.approach[:, k].astype(int) for k, name in enumerate(approach_columns(robot))}
    if poses.scan_names != tuple(f"{pose_id}.ply" for pose_id in poses.ids):
        columns["scan"] = poses.scan_names
    frame = pd.DataFrame(columns)
    return pd.concat([frame, poses.extra.frame], axis=1) if poses.extra.names else frame
