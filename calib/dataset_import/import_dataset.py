"""A dataset folder from a robot, a table of joints and measurements: all faults at once, nothing half-written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.dataset.dataset import Dataset
from calib.dataset_import.reading import (
    Work,
    beside,
    joint_values,
    point_values,
    points_scale,
    pose_ids,
    recognised,
    rows_of_points,
)
from calib.dataset_import.units import ANGLES_RAD, LENGTHS_MM, joint_units
from calib.dataset_import.writing import points_text, poses_text, written
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.user_tables.user_table import load_table


@dataclass(frozen=True)
class Imported:
    """The dataset as it was written, and what was recognised, a line each."""

    dataset: Dataset
    said: tuple[str, ...]


def import_dataset(
    out: Path,
    robot: Robot,
    joints: Path,
    points: Path | None = None,
    scans: Path | None = None,
    mapping: Mapping[str, tuple[str, str]] | None = None,
) -> Imported:
    """Write a dataset folder of a robot and a user's tables. `points` None: the joints' table has them, or scans.

    Raises DatasetError with every fault that was found, a line each; nothing is written then.
    """
    _require_free(out)
    work, mapping = Work(robot), dict(mapping or {})
    table = load_table(joints)
    other = None if points is None or points.resolve() == joints.resolve() else load_table(points)
    tables = [table] if other is None else [table, other]
    for column in mapping:
        if "*" not in column and not any(column in each.columns for each in tables):
            work.fault(
                f"--map {column}=...: no such column; there are {', '.join(c for t in tables for c in t.columns)}"
            )
    meant = recognised(work, table, mapping, positions=other is None)
    of_points = meant if other is None else recognised(work, other, mapping, positions=True, joints=False)
    if scans is not None and not scans.is_dir():
        work.fault(f"{scans}: no such folder of scans")
    q_file = joint_values(work, table, meant)
    seen = point_values(work, other or table, of_points, needed=scans is None)
    ids = pose_ids(work, table, meant)
    row_of = rows_of_points(work, table, ids, other, of_points)
    work.raise_all()
    assert q_file is not None
    near = None if seen is None else beside(q_file, seen, row_of)
    told = [meant.columns[f"q{k + 1}"].unit for k in range(robot.n_joints)]
    units, how = joint_units(robot, q_file, told, near)
    work.said.append(
        f"{table.path}: joints are {', '.join(meant.columns[f'q{k + 1}'].name for k in range(robot.n_joints))}"
        + (f"; {how}" if how else f" in {' and '.join(sorted(set(units)))} by their names")
    )
    scale = np.array([ANGLES_RAD.get(unit) or LENGTHS_MM[unit] for unit in units])
    if seen is not None:
        seen = seen * points_scale(work, other or table, of_points, robot, q_file * scale, seen, row_of)
    if other is not None and of_points.rest:
        work.said.append(f"{other.path}: other columns are left out: {', '.join(of_points.rest)}")
    work.raise_all()
    measured = None if near is None else np.asarray(np.isfinite(near).all(axis=1))
    poses_csv = poses_text(work, table, meant, ids, q_file * scale, scans, measured)
    points_csv = (
        None if seen is None else points_text(other or table, of_points, [ids[i] for i in row_of], seen)
    )
    dataset = written(out, robot, poses_csv, points_csv, scans, ids, f"imported from {joints.name}")
    return Imported(dataset, tuple(work.said))


def _require_free(out: Path) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DatasetError(f"{out}: exists and is not empty; name a new folder")
