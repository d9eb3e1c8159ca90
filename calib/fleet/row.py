"""What is known of one dataset of a fleet: a small row, whatever the dataset's size."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class EffectSize:
    """How large one member of an effect is, on one joint where it has one."""

    effect: str  # family
    joint: int | None  # counted from 1
    parameter: str  # full name, which ends with its unit
    value: float
    sigma: float | None
    unit: str
    moves_mm: float  # how far it moves the measured points, RMS about their mean


@dataclass(frozen=True)
class Rmse:
    """3D RMSE at three stages, mm; None where the dataset has no such poses."""

    nominal_mm: float | None = None
    links_mm: float | None = None  # with calibrated links alone
    final_mm: float | None = None  # with all that the diagnosis added


@dataclass(frozen=True)
class Row:
    """One dataset: who was measured, how far it is off, what is missing. Equal files and options give an equal row."""

    path: str  # below the fleet's folder, with slashes
    name: str
    serial: str
    site: str
    date: str
    about: dict[str, str]  # further keys of [about], as a gear's batch
    robot: str
    joints: int
    poses: int
    points: int
    left_out: tuple[str, ...] = ()  # ids of poses that count for nothing, as no corner was found or as they stand out
    train: Rmse = field(default_factory=Rmse)
    test: Rmse = field(default_factory=Rmse)
    noise_ratio: float | None = None  # the last error over the declared noise
    passed: bool = False  # as `calib.validation.acceptance.check` has it
    reasons: tuple[str, ...] = ()  # why it did not pass
    verdict: str = ""  # of the diagnosis; "" where there was none
    missing: tuple[str, ...] = ()
    suspected: tuple[str, ...] = ()
    ambiguous: tuple[str, ...] = ()
    sizes: tuple[EffectSize, ...] = ()  # of the effects in the last model
    words: str = ""  # the verdict in words, or why there is none

    @property
    def arm(self) -> tuple[str, str]:
        """Which arm was measured: robot and serial number; a dataset without a number is an arm of its own."""
        return self.robot, self.serial or f"({self.path})"

    @property
    def headline(self) -> str:
        """The verdict's first sentence, which stands without what a full diagnosis says before it."""
        first, dot, _ = self.words.partition(". ")
        return first + dot.strip()

    @property
    def error_mm(self) -> float | None:
        """The last error: of the test poses, or of the training poses where there are none."""
        return self.train.final_mm if self.test.final_mm is None else self.test.final_mm


@dataclass(frozen=True)
class Failure:
    """A dataset without a row, or a folder that could not be looked into."""

    path: str
    reason: str  # one line
    attempts: int = 1
