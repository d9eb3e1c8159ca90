"""A dataset made of a robot and a user's tables at once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from calib.dataset.dataset import Dataset
from calib.dataset_import.columns import Meaning
from calib.dataset_import.import_dataset import scan_files, write_plan
from calib.dataset_import.plan import ImportSources, plan_import
from calib.kinematics.robot import Robot
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile


class Imported(NamedTuple):
    """The written dataset, with what the plan noted and doubted."""

    dataset: Dataset
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


def import_dataset(
    out: Path, robot: Robot, joints: Path, points: Path | None = None, scans: Path | None = None,
    mapping: Mapping[str, Meaning] | None = None,
) -> Imported:  # fmt: skip
    """Write a dataset folder from a robot and a user's tables."""
    robots, found = (RobotReading("", RobotFile(robot, None)),), {} if scans is None else scan_files(scans)
    plan = plan_import(ImportSources(robots, joints, points, found, mapping or {}))
    return Imported(write_plan(plan, out), plan.notes, plan.doubts)
