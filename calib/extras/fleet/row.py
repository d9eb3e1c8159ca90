"""Row of the fleet's table for one dataset, small whatever the dataset's size."""

from __future__ import annotations

from dataclasses import dataclass, field

from calib.brief import Brief


@dataclass(frozen=True)
class EffectSize:
    """Size of one member of an effect, such as the effect on one joint."""

    effect: str  # family
    joint: int | None  # counted from 1
    parameter: str  # full name, which ends with its unit
    value: float
    sigma: float | None
    unit: str
    moves_mm: float  # RMS displacement of the measured points, about its mean


@dataclass(frozen=True)
class Rmse:
    """3D RMSE at three stages, mm; None where the dataset has no such poses."""

    nominal_mm: float | None = None
    links_mm: float | None = None  # with calibrated links alone
    final_mm: float | None = None  # with all that the diagnosis added


@dataclass(frozen=True)
class Row(Brief):
    """Row of the fleet's table for one dataset: arm, errors, verdict and effects.

    Equal files and options give an equal row.
    """

    path: str  # below the fleet's folder, with slashes
    name: str
    serial: str
    site: str
    date: str
    about: dict[str, str]  # further keys of [about], such as a gear's batch
    robot: str
    joints: int
    poses: int
    points: int
    left_out: tuple[str, ...] = ()  # ids of poses without a corner, and of outliers
    train: Rmse = field(default_factory=Rmse)
    test: Rmse = field(default_factory=Rmse)
    noise_ratio: float | None = None  # last error over the declared noise
    passed: bool = False  # by `calib.check`
    reasons: tuple[str, ...] = ()  # why it did not pass
    verdict: str = ""  # of the diagnosis; "" where there was none
    missing: tuple[str, ...] = ()
    suspected: tuple[str, ...] = ()
    ambiguous: tuple[str, ...] = ()
    sizes: tuple[EffectSize, ...] = ()  # of the effects in the last model
    likely: dict[str, float] = field(default_factory=dict)  # probability of each effect in the last model
    words: str = ""  # verdict as text, or why there is none

    @property
    def arm(self) -> tuple[str, str]:
        """Name of the arm, from robot and serial number; without a number each dataset is an arm of its own."""
        return self.robot, self.serial or f"({self.path})"

    @property
    def delivered_mm(self) -> float | None:
        """RMSE of the nominal robot at the same poses as `error_mm`."""
        return self.train.nominal_mm if self.test.final_mm is None else self.test.nominal_mm

    @property
    def error_mm(self) -> float | None:
        """RMSE of the last model at the test poses, or at the training poses where there are none."""
        return self.train.final_mm if self.test.final_mm is None else self.test.final_mm


@dataclass(frozen=True)
class Failure:
    """A dataset without a row, or a folder that could not be listed."""

    path: str
    reason: str  # one line
