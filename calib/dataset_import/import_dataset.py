"""A dataset folder from a robot, a table of joints and measurements: all faults at once, nothing half-written."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.dataset_import.columns import Meaning
from calib.dataset_import.plan import Given, ImportPlan, plan_import
from calib.dataset_import.writing import written
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile


@dataclass(frozen=True)
class Imported:
    """The dataset as it was written, and what was recognised and what is doubtful, a line each."""

    dataset: Dataset
    said: tuple[str, ...]
    doubts: tuple[str, ...] = ()


def import_dataset(
    out: Path,
    robot: Robot,
    joints: Path,
    points: Path | None = None,
    scans: Path | None = None,
    mapping: Mapping[str, Meaning] | None = None,
) -> Imported:
    """Write a dataset folder of a robot and a user's tables. `points` None: the joints' table has them, or scans.

    Raises DatasetError with every fault that was found, a line each; nothing is written then.
    """
    require_free(out)
    robots = (RobotReading("", RobotFile(robot, None)),)
    found = {} if scans is None else scan_files(scans)
    return write_plan(plan_import(Given(robots, joints, points, found, dict(mapping or {}))), out)


def write_plan(plan: ImportPlan, out: Path) -> Imported:
    """The dataset of a plan, written whole. Raises DatasetError with all faults; nothing is written then."""
    require_free(out)
    return Imported(written(out, plan.require()), plan.said, plan.doubts)


def copy_dataset(folder: Path, out: Path) -> Dataset:
    """A ready dataset's folder, its files as they are, at another place, whole. Raises DatasetError."""
    require_free(out)
    load_dataset(folder)
    out.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.parent, prefix=f".{out.name[:50]}.") as made:
        shutil.copytree(folder, Path(made) / "copy")
        if out.exists():
            out.rmdir()  # empty
        (Path(made) / "copy").rename(out)
    return load_dataset(out)


def scan_files(folder: Path) -> dict[str, Path]:
    """The files of a folder of scans by their stems. Raises DatasetError."""
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder of scans")
    return {path.stem: path for path in sorted(folder.iterdir()) if path.is_file()}


def require_free(out: Path) -> None:
    """Raise DatasetError where a folder holds something already."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DatasetError(f"{out}: exists and is not empty; name a new folder")
