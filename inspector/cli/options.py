"""Options of each subcommand, filled by the parser. Nothing slow is imported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from calib.options import FitOptions


@dataclass(frozen=True, kw_only=True)
class Output:
    """Options common to all commands: the form of the output."""

    json: bool  # one JSON object in place of text
    stdout: TextIO  # with --json, `sys.stdout` leads to stderr while a command runs


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """Options of `serve`."""

    path: Path
    host: str
    port: int
    session: Path | None
    effects_file: Path | None
    data: Path | None


@dataclass(frozen=True, kw_only=True)
class CornersOptions(Output):
    """Options of `corners`."""

    path: Path
    out: Path | None
    orientation: bool
    processes: int | None  # None: one for each core
    finder: Path | None


@dataclass(frozen=True, kw_only=True)
class RedundancyOptions(Output):
    """Options of `redundancy`."""

    path: Path
    out: Path | None
    residual: str
    leave_out: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class _FittingOptions(Output):
    """Common options of commands that fit a model."""

    path: Path
    residual: str
    effect: Sequence[str]
    effects_file: Path | None
    no_prior: bool
    tolerance: Sequence[tuple[str, float]]  # parameter, mm or rad
    hold: Sequence[str]
    robust: bool
    leave_out: Sequence[str]  # ids of poses
    finder: Path | None  # of targets in the scans, a file of the user's own

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
class CalibrateOptions(_FittingOptions):
    """Options of `calibrate`."""

    add: Sequence[str]
    model: Path | None  # a model.json whose effects are held
    refit: str | None
    type: Path | None  # what arms of the type share, of `pool`
    out: Path | None
    model_out: Path | None
    urdf_out: Path | None
    kinematics_out: Path | None
    template: Sequence[Path]
    hand_eye_out: Path | None
    parent_frame: str | None
    parent_at: str
    camera_frame: str
    force: bool
    residuals: Path | None
    scene: Path | None
    session: Path | None
    learned_out: Path | None


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(_FittingOptions):
    """Options of `validate`."""

    folds: int
    model: Path | None  # a model.json in place of fits


@dataclass(frozen=True, kw_only=True)
class CorrectOptions(_FittingOptions):
    """Options of `correct`."""

    add: Sequence[str]
    model: Path | None  # a model.json in place of a fit
    joints: Path | None  # a table of joint targets, or
    program: Path | None  # a robot program
    tool_frame: list[str]  # of the program, in the maker's numbers, each perhaps with its name
    work_frame: list[str]
    others: list[Path]  # more files of the program
    out: Path
    what: str | None
    force: bool


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(_FittingOptions):
    """Options of `diagnose`."""

    max_steps: int
    learned_out: Path | None
    model_out: Path | None
    force: bool


@dataclass(frozen=True, kw_only=True)
class FollowOptions(Output):
    """Options of `follow`."""

    path: Path
    residual: str
    tolerance_mm: float | None  # predicted error that is asked for
    once: bool
    until_enough: bool

    def fit_options(self) -> FitOptions:
        """Fit options given by --residual."""
        return FitOptions(residual=self.residual)


@dataclass(frozen=True, kw_only=True)
class RepeatOptions(Output):
    """Options of `repeat`."""

    path: Path
    others: Sequence[Path]


@dataclass(frozen=True, kw_only=True)
class VerifyOptions(Output):
    """Options of `verify`."""

    path: Path
    results: Sequence[Path]


@dataclass(frozen=True, kw_only=True)
class PoolOptions(Output):
    """Options of `pool`."""

    path: Path
    others: Sequence[Path]
    residual: str
    effect: Sequence[str]
    poses: int
    out: Path | None


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Output):
    """Options of `compare`, for the fits of both datasets."""

    path: Path
    other: Path
    residual: str
    effect: Sequence[str]
    effects_file: Path | None
    add: Sequence[str]

    def fit_options(self) -> FitOptions:
        """Fit options of both calibrations, given by --residual."""
        return FitOptions(residual=self.residual)


@dataclass(frozen=True, kw_only=True)
class WatchOptions(Output):
    """Options of `watch`."""

    path: Path
    new: Sequence[Path]
    effect: Sequence[str]
    effects_file: Path | None
    add: Sequence[str]
    scanner_moved: bool
    tolerance_mm: float | None
    out: Sequence[Path]

    def fit_options(self) -> FitOptions:
        """Fit options of the earlier calibration."""
        return FitOptions()


@dataclass(frozen=True, kw_only=True)
class ReportOptions(_FittingOptions):
    """Options of `report`."""

    out: Path  # a page, or with the suffix .pdf its print
    pdf: Path | None
    force: bool


@dataclass(frozen=True, kw_only=True)
class FiguresOptions(_FittingOptions):
    """Options of `figures`."""

    name: Sequence[str]  # of the figures to write; all where empty
    out: Path | None  # None: they are listed
    png: bool


@dataclass(frozen=True, kw_only=True)
class McpOptions:
    """Options of `mcp`."""

    root: Sequence[Path]
    allow_code: bool
    timeout_s: float


@dataclass(frozen=True, kw_only=True)
class SampleOptions(Output):
    """Options of `sample`."""

    name: str | None  # None: they are listed
    out: Path | None  # None: a folder of the sample's name


@dataclass(frozen=True, kw_only=True)
class JigOptions(Output):
    """Options of `jig`."""

    part: str  # "plate", "corner" or "stem"
    out: Path | None  # None: a file of the part's name
    sockets: tuple[int, int]  # columns and rows
    pitch_mm: float
    ball_mm: float
    edge_mm: float
    length_mm: float
    bolts: str


@dataclass(frozen=True, kw_only=True)
class SimulateOptions(Output):
    """Options of `simulate`."""

    path: Path
    robot: str
    poses: int
    effect: Sequence[str]
    scans: bool
    smooth_noise_mm: float | None
    correlation_mm: float | None
    white: bool
    mount: str
    seed: int
    noise_mm: float


@dataclass(frozen=True, kw_only=True)
class CheckOptions(_FittingOptions):
    """Options of `check`."""

    max_test_rmse_mm: float | None


@dataclass(frozen=True, kw_only=True)
class FleetOptions(Output):
    """Options of `fleet`."""

    path: Path
    out: Path
    workers: int | None  # None: one for each core
    scheduler: str | None
    timeout: float  # seconds
    max_test_rmse_mm: float | None
    fresh: bool


@dataclass(frozen=True, kw_only=True)
class RobotFileOptions(Output):
    """Options for what a robot's file does not define."""

    tip: str | None
    base: str | None
    convention: str | None
    model: str | None
    xacro_arg: Sequence[tuple[str, str]]
    package: Sequence[tuple[str, Path]]


@dataclass(frozen=True, kw_only=True)
class PlanOptions(_FittingOptions, RobotFileOptions):
    """Options of `plan`."""

    poses: int | None
    add: int | None
    purpose: str
    criterion: str
    region: str | tuple[float, ...]  # a name, or x0, x1, y0, y1, z0, z1 of a box, mm
    candidates: Path | None
    target: str  # "corner" or "ball"
    boxes: Sequence[tuple[float, ...]]  # obstacles, as the box of a region
    scanner: tuple[float, ...] | None  # x, y, z, mm; then those of the point that it looks at
    noise_mm: float | None
    payload_kg: float | None
    seed: int
    out: Path | None
    program: Path | None  # measuring program
    template: Path | None
    template_out: Path | None
    speed: float | None  # in the unit of the program's language
    settle_s: float | None
    stand_s: float | None
    trigger: tuple[str, ...] | None  # output and its signal, or socket, host and port
    pulse_s: float | None
    measured: tuple[str, ...] | None  # input and its signal, or reply
    tool_name: str | None


@dataclass(frozen=True, kw_only=True)
class ConvertOptions(RobotFileOptions):
    """Options of `convert`."""

    source: Path
    out: Path
    template: Path | None
    force: bool


@dataclass(frozen=True, kw_only=True)
class ImportOptions(RobotFileOptions):
    """Options of `import`."""

    path: Path
    robot: str | None
    source: Path | None  # a folder or a zip that holds all of it
    joints: Path | None
    points: Path | None
    scans: Path | None
    map: Sequence[str]
    sigma: float | None  # of a measured point, mm
    place_sigma: float | None  # of a known place, mm
    tool: tuple[float, float, float] | None  # mm
    images: Path | None
    board: str | None
    board_sigma: float | None  # percent
    dictionary: str | None
    intrinsics: Path | None
    marker_poses: Path | None
    flange_poses: Path | None
    length_unit: str | None
    mount: str | None
    skip_bad_rows: bool
    dry_run: bool
    diagnose: bool
