"""From the files of a user and what was chosen among them to the plan of an import."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from calib.dataset_import.columns import Meaning
from calib.dataset_import.files.archive import is_archive, unpack
from calib.dataset_import.files.user_files import UserFiles, look_through
from calib.dataset_import.plan import Given, ImportPlan, plan_import
from calib.errors import CalibError
from calib.robot_formats.conventions import RobotReading, robot_readings
from calib.robot_formats.robot_file import Reading


@dataclass(frozen=True)
class Choice:
    """What is taken of a user's files; None: the likeliest."""

    robot: str | None = None  # the name of a built-in one, or a file
    reading: Reading = field(default_factory=Reading)
    joints: Path | None = None
    points: Path | None = None
    mapping: Mapping[str, Meaning] = field(default_factory=dict)


def plan_of_files(files: UserFiles, choice: Choice) -> ImportPlan:
    """The plan of an import; whatever is wrong stands in its faults."""
    joints = choice.joints or files.joints
    points = choice.points
    if points is None and (choice.joints is None or choice.joints == files.joints):
        points = files.points
    robots, faults = _robots(files, choice)
    return plan_import(Given(robots, joints, points, files.scans, choice.mapping, faults))


def _robots(files: UserFiles, choice: Choice) -> tuple[tuple[RobotReading, ...], tuple[str, ...]]:
    name = choice.robot or next(map(str, files.robots), None)
    if name is None:
        return (), ()
    try:
        return tuple(robot_readings(name, choice.reading)), ()
    except CalibError as error:
        return (), (str(error),)


@contextmanager
def unpacked(source: Path) -> Iterator[UserFiles]:
    """The files of a folder or a zip, while inside. Raises CalibError."""
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
    """The plan with the names of files as the user knows them, without the folder that they lie in meanwhile."""

    def short(lines: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(line.replace(f"{folder}/", "") for line in lines)

    return replace(plan, said=short(plan.said), doubts=short(plan.doubts), faults=short(plan.faults))
