"""Joint targets as they are commanded, and files of them in the forms that plug-ins write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.array_types import Array
from calib.errors import CalibError
from calib.kinematics.robot import Robot
from calib.plugins import load
from calib.robot_formats.target_form import TargetForm, form_of_targets

_OF_PROGRAMS = (".script", ".src", ".dat", ".mod")  # of robot programs, which are no tables


@dataclass(frozen=True)
class JointTarget:
    """A joint target with the user's name for it."""

    name: str
    q: Array  # (n,) rad or mm, as it is commanded
    left_out: str = ""  # reason for leaving it out; "" where it is kept


@dataclass(frozen=True)
class MeasuringStep:
    """A pose to measure, with the way to it from the pose before."""

    target: JointTarget
    way: tuple[JointTarget, ...] = ()  # points that the arm passes at rest, in this order
    ask: str = ""  # what a person has to do or look at before the arm moves; "": nothing


def require_targets(path: Path, robot: Robot) -> None:
    """Raise CalibError where no plug-in writes the program that a file's suffix names, or it cannot hold the arm."""
    form = form_of_targets(path)
    if form is not None and form.check:
        load(form.check)(path, robot)
    if form is None and path.suffix.lower() in _OF_PROGRAMS:
        raise CalibError(f"{path}: point lists of controllers are written by the extra robot_programs; name a .csv")


def written_targets(
    form: TargetForm, path: Path, robot: Robot, targets: Sequence[JointTarget], heading: Sequence[str]
) -> str:
    """Text of a file of joint targets. Raises CalibError for an arm that its form cannot hold."""
    if form.check:
        load(form.check)(path, robot)
    return load(form.writer)(path, robot, targets, heading)
