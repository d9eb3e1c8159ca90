"""Options of the commands that fit a model, and of the one that plans poses. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.options import CORRECTION_KINDS, DEFAULT_FOLDS, REFITS, FitOptions
from calib.planning.purpose import purposes
from inspector.cli.options import values
from inspector.cli.options.declaration import argument, flag, option, several
from inspector.cli.options.shared import (
    A_DATASET,
    DATASETS,
    FittingOptions,
    Output,
    RobotFileOptions,
    WithAdding,
    WithModelOut,
    WithResidual,
)


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions(WithModelOut, FittingOptions, WithAdding):
    """Fit the five-parameter model."""

    out: Path | None = option("write robot.toml, its table the best without effects")
    urdf_out: Path | None = option("write the template with calibrated origins, as --out")
    kinematics_out: Path | None = option("the same for joint origins as makers' YAML", metavar="FILE.yaml")
    template: Sequence[Path] = several(
        "your own .urdf or .yaml of this arm; default: the file that `import` took the robot from"
    )
    force: bool = flag("write although the fit is no improvement")
    residuals: Path | None = option("write what is left over, a row a pose with all inputs", metavar="FILE.csv")
    session: Path | None = option("write a session that serve --session opens", metavar="FILE.json")
    model: Path | None = option(
        "hold the effects and curves of this saved model, with --refit (of calibrate --model-out)", metavar="FILE.json"
    )
    refit: str | None = option("what is fitted anew with --model: frame and tool, or links too (links)", choices=REFITS)


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(FittingOptions):
    """How good the fit is away from its poses, and whether more would help."""

    folds: int = option(f"default {DEFAULT_FOLDS}", DEFAULT_FOLDS)
    model: Path | None = option(
        "errors of this saved model at the dataset's points, as it is (of calibrate --model-out)", metavar="FILE.json"
    )


@dataclass(frozen=True, kw_only=True)
class CorrectOptions(FittingOptions, WithAdding):
    """Joint targets that bring the real arm where the nominal one should be."""

    joints: Path | None = option("targets, columns as poses.csv", group="targets", required=True)
    out: Path = option(
        "write the corrected targets: .csv; of a program the corrected one, with its suffix",
        required=True,
    )
    what: str | None = option(
        "what is brought right (default: pose where the fit knows the attitude, else position)",
        choices=CORRECTION_KINDS,
    )
    force: bool = flag("go on although the fit is no improvement")
    model: Path | None = option("use this saved model and fit nothing (of calibrate --model-out)", metavar="FILE.json")


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(WithModelOut, FittingOptions):
    """Which physical effect is missing, step by step."""

    max_steps: int = option("effects to add at the most (default 3)", 3, metavar="N")
    force: bool = flag("write although the fit is no improvement")
    verbose: bool = flag("print all: the reasons, more candidates, what cannot be tested")


@dataclass(frozen=True, kw_only=True)
class CompareOptions(WithResidual, WithAdding, Output):
    """What differs between two calibrations: before and after a repair, or two arms of a type."""

    path: Path = argument(A_DATASET)
    other: Path = argument("dataset folder to compare it with")

    def fit_options(self) -> FitOptions:
        """Fit options of both calibrations, given by --residual."""
        return FitOptions(residual=self.residual)


@dataclass(frozen=True, kw_only=True)
class RepeatOptions(Output):
    """Which causes come back in several recordings of one arm, and whether their sizes agree."""

    path: Path = argument("dataset folder of the first recording")
    others: Sequence[Path] = argument("further recordings of the same arm", metavar="OTHER", repeated=True)


@dataclass(frozen=True, kw_only=True)
class ReportOptions(FittingOptions):
    """One self-contained HTML page to send to someone."""

    out: Path = option("write the page", required=True)
    force: bool = flag("replace a file that is no report")


@dataclass(frozen=True, kw_only=True)
class CheckOptions(FittingOptions):
    """The whole chain: pass or fail, and why."""

    path: Path = argument(DATASETS)
    max_test_rmse_mm: float | None = option("what the test poses' error may be", metavar="X", parse=values.rmse_mm)


@dataclass(frozen=True, kw_only=True)
class PlanOptions(FittingOptions, RobotFileOptions):
    """Which poses to measure, and the error that they will leave."""

    path: Path = argument("dataset folder, or a robot: a file of any form, rb5 or panda")
    poses: int | None = option("a first set of K poses (default 20 for a robot)", metavar="K", parse=values.pose_count)
    add: int | None = option(
        "K more poses for a dataset (default 5, or as many as the purpose takes)",
        metavar="K",
        parse=values.pose_count,
    )
    purpose: str = option(
        ", ".join([*(purpose.help for purpose in purposes().values()), "or effects with commas between"]),
        "calibration",
        metavar="WHAT",
        spelled=["--for"],
    )
    region: str | tuple[float, ...] = option(  # a name, or x0, x1, y0, y1, z0, z1 of a box, mm
        "where it is to be right: auto (the test poses where there are), test, measurable, all (joints' ranges), "
        "or a box X0,X1,Y0,Y1,Z0,Z1 of the tool point, mm in the base frame",
        "auto",
        metavar="WHERE",
        parse=values.plan_region,
    )
    candidates: Path | None = option("choose among these poses (columns as poses.csv) alone", metavar="FILE.csv")
    target: str = option(
        "of a robot: what is measured, a jig that shows three faces, or a ball or mirror, seen from everywhere",
        "corner",
        choices=("corner", "ball"),
    )
    boxes: Sequence[tuple[float, ...]] = several(  # as the box of a region
        "of a robot: an obstacle, mm in the base frame; may be given several times",
        metavar="X0,X1,Y0,Y1,Z0,Z1",
        parse=values.box,
    )
    scanner: tuple[float, ...] | None = option(  # x, y, z, mm; then those of the point that it looks at
        "where the scanner stands, mm in the base frame, and the point that it looks at (x,y,z)",
        metavar="X,Y,Z[,TOWARD]",
        parse=values.scanner_place,
    )
    noise_mm: float | None = option(
        "of a measured point, each axis, for a robot (default 0.05)", metavar="X", parse=values.rmse_mm
    )
    payload_kg: float | None = option(
        "a known payload that some poses may carry, for --for split, prove (default 2) and effects",
        metavar="X",
        parse=values.mass_kg,
    )
    seed: int = option("of the poses to choose from (default 0)", 0, parse=values.seed)
    out: Path | None = option("write the poses: .csv (poses.csv)")
