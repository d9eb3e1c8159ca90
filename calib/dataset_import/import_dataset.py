"""A dataset folder made of a user's files: all faults are reported at once, and no partial dataset is written."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.dataset.dataset import Dataset
from calib.dataset.files.atomic_write import new_folder, require_free
from calib.dataset.files.folder import load_dataset
from calib.dataset_import.archive import is_archive, unpack
from calib.dataset_import.flange_import import plan_of_flange_poses
from calib.dataset_import.plan import ImportPlan, ImportSources, plan_import
from calib.dataset_import.user_files import BOTH, POINTS, UserFiles, is_workbook, look_through, of_workbook
from calib.dataset_import.writing import written
from calib.errors import CalibError, DatasetError
from calib.progress import OnProgress
from calib.robot_formats.conventions import RobotReading, robot_readings


def plan_of_files(files: UserFiles, choice: ImportSources, on_progress: OnProgress | None = None) -> ImportPlan:
    """Plan of an import of the chosen files, with all faults of the files in `faults`.

    `on_progress` is called with (done, total, file name) after each file that a plug-in has measured in.
    """
    joints = choice.joints or files.joints
    points = choice.points
    if points is None and (choice.joints is None or choice.joints == files.joints):
        points = files.points
    if choice.joints is not None and is_workbook(choice.joints):
        book = of_workbook(choice.joints)
        joints, points = book.joints or joints, points or book.points
    if choice.points is not None and is_workbook(choice.points):
        points = next(iter(of_workbook(choice.points).of(POINTS, BOTH)), points)
    robots, faults = _robots(files, choice)
    sources = replace(choice, robots=robots, joints=joints, points=points, scans=files.scans, faults=faults)
    if choice.to_measure is not None:
        if faults:
            raise CalibError(faults[0])
        return plan_import(choice.to_measure.sources(sources, on_progress))
    if choice.flange_poses is not None:
        return plan_of_flange_poses(replace(sources, points=choice.points), choice.flange_poses)
    return plan_import(sources)


def _robots(files: UserFiles, choice: ImportSources) -> tuple[tuple[RobotReading, ...], tuple[str, ...]]:
    name = choice.robot or next(map(str, files.robots), None)
    if name is None:
        return (), ()
    try:
        return tuple(robot_readings(name, choice.reading)), ()
    except CalibError as error:
        return (), (str(error),)


@contextmanager
def unpacked(source: Path) -> Iterator[UserFiles]:
    """Context with the files of a folder, or of a zip unpacked for its duration. Raises CalibError."""
    if source.is_dir():
        yield look_through(source)
        return
    if not source.is_file():
        raise CalibError(f"{source}: no such file; give a zip or a folder with a robot and tables")
    if not is_archive(source):
        raise CalibError(f"{source}: is no zip; give a zip or a folder, or --robot, --joints and --points")
    with TemporaryDirectory() as made:
        unpack(source, Path(made))
        yield look_through(Path(made))


def without_folder(plan: ImportPlan, folder: Path) -> ImportPlan:
    """The plan with file names relative to the temporary folder, as the user knows them."""

    if folder == Path():  # nothing was unpacked: paths stay as they were given
        return plan

    def short(lines: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(line.replace(f"{folder}/", "") for line in lines)

    rows = tuple(
        replace(row, path=row.path.relative_to(folder)) if row.path.is_relative_to(folder) else row
        for row in plan.bad_rows
    )
    return replace(plan, notes=short(plan.notes), doubts=short(plan.doubts), faults=short(plan.faults), bad_rows=rows)


def write_plan(plan: ImportPlan, out: Path) -> Dataset:
    """Write the dataset of a plan. Raises DatasetError with all faults and then writes nothing."""
    require_free(out)
    return written(out, plan.require())


def copy_dataset(folder: Path, out: Path) -> Dataset:
    """Copy a dataset folder, its files unchanged, to a new folder. Raises DatasetError."""
    load_dataset(folder)
    with new_folder(out) as copy:
        shutil.copytree(folder, copy)
    return load_dataset(out)


def scan_files(folder: Path) -> dict[str, Path]:
    """Files of a folder of scans, by stem. Raises DatasetError."""
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder of scans")
    return {path.stem: path for path in sorted(folder.iterdir()) if path.is_file()}
