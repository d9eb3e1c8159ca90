"""Options that several commands take. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from calib.options import RESIDUAL_KINDS, FitOptions
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, flag, option, several

if TYPE_CHECKING:
    from calib.dataset.dataset import Dataset
    from calib.robot_formats.robot_file import ReadOptions

A_DATASET = "dataset folder"
DATASETS = "dataset folder, or a folder of them"


@dataclass(frozen=True, kw_only=True)
class Output:
    """Options common to all commands: the form of the output."""

    json: bool = flag("one JSON object on stdout, nothing else")
    stdout: TextIO  # with --json, `sys.stdout` leads to stderr while a command runs
    added: tuple[Any, ...] = ()  # each an `Addition` of a plug-in, of which options are given


@dataclass(frozen=True, kw_only=True)
class WithResidual:
    """Option of what a fit minimises; without it, what is usual for the dataset."""

    residual: str = option(
        "what is fitted: places with the scanner's place unknown (position, the default), distances to the "
        "reference pose, distances of pairs of poses, or full poses (the default where a camera saw a board)",
        choices=RESIDUAL_KINDS,
    )


@dataclass(frozen=True, kw_only=True)
class WithEffects:
    """Options of the effects in a model from the start."""

    effect: Sequence[str] = several("put a whole effect into the model, all joints", metavar="NAME")
    effects_file: Path | None = option("effects of your own", metavar="FILE.py")


@dataclass(frozen=True, kw_only=True)
class WithAdding(WithEffects):
    """Options of the effects in a model from the start, and of those that are added as the ranking proposes them."""

    add: Sequence[str] = several(
        "add an effect as the ranking proposes it: only the joints that show it, as the page's button does",
        metavar="NAME",
    )

    def fit_options(self) -> FitOptions:
        """Fit options: the usual ones, where a command has no options of its own for them."""
        return FitOptions()


@dataclass(frozen=True, kw_only=True)
class WithLeaveOut:
    """Options of poses, by their ids: whose points are not used, and from which on the instrument stood elsewhere."""

    leave_out: Sequence[str] = several(
        "take no notice of what was measured at a pose; may be given several times", metavar="POSE"
    )
    new_setup: Sequence[str] = several(
        "the instrument was moved just before this pose: find its place anew from there on; may be given several times",
        metavar="POSE",
    )

    def of_dataset(self, dataset: Dataset) -> Dataset:
        """The dataset with these poses left out, and with these setups. Raises DatasetError on an unknown pose."""
        return dataset.with_new_setups(self.new_setup).leave_out(self.leave_out)


@dataclass(frozen=True, kw_only=True)
class WithFinder:
    """Option of a finder of targets in the scans, a file of the user's own."""

    finder: Path | None = option("find(scan, wanted) of your own, for targets in the scans", metavar="FILE.py")


@dataclass(frozen=True, kw_only=True)
class WithModelOut:
    """Option of the file for the model."""

    model_out: Path | None = option("write the full model, which correct and validate take", metavar="FILE.json")


@dataclass(frozen=True, kw_only=True)
class WithHeld:
    """Options of how parameters are held, and of poses that stand out."""

    no_prior: bool = flag("do not hold parameters within their tolerance")
    tolerance: Sequence[tuple[str, float]] = several(
        "tolerance of one parameter, mm or rad (default 1 mm, 0.0087 rad); may be given several times",
        metavar="NAME=VALUE",
        parse=values.named_number,
    )
    hold: Sequence[str] = several(
        "keep a parameter at its nominal: d5, theta1 or θ1; links: all of the arm", metavar="NAME"
    )
    robust: bool = flag("leave poses out that stand out of all others")


@dataclass(frozen=True, kw_only=True)
class FittingOptions(WithResidual, WithEffects, WithHeld, WithLeaveOut, WithFinder, Output):
    """Options of commands that fit a model to a dataset."""

    path: Path = argument(A_DATASET)

    def fit_options(self) -> FitOptions:
        """Fit options given by --residual, --hold, --no-prior, --tolerance and --robust."""
        return FitOptions(
            residual=self.residual,
            prior=not self.no_prior,
            fixed=tuple(self.hold),
            tolerances=dict(self.tolerance),
            robust=self.robust,
        )


@dataclass(frozen=True, kw_only=True)
class RobotFileOptions(Output):
    """Options for what a robot's file does not define."""

    tip: str | None = option("the last link (default: the only one that is a tip)", metavar="LINK")
    base: str | None = option("the first link (default: the root)", metavar="LINK")
    convention: str | None = option(
        "of a table of theta, d, a, alpha (modified: Craig's)", choices=("standard", "modified")
    )
    model: str | None = option("which arm a UR calibration.conf is of, such as ur10e", metavar="NAME")
    xacro_arg: Sequence[tuple[str, str]] = several(
        "an argument of a .xacro; may be given several times", metavar="NAME:=VALUE", parse=values.xacro_argument
    )
    package: Sequence[tuple[str, Path]] = several(
        "folder of a ROS package: what $(find NAME) is in a .xacro, and where package://NAME/... of meshes lies; "
        "several times",
        metavar="NAME=FOLDER",
        parse=values.named_folder,
        spelled=("--package", "--xacro-package"),
    )

    def reading(self, *, named: bool = True) -> ReadOptions:
        """Options for `read_robot`; a xacro is run and meshes are looked for only where the user `named` the file."""
        from calib.robot_formats.robot_file import ReadOptions  # slow to load

        xacro_args, packages = (dict(self.xacro_arg), dict(self.package)) if named else (None, None)
        return ReadOptions(self.tip, self.base, self.convention, self.model, xacro_args, packages)
