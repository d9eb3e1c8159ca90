"""The verdict of a diagnosis as facts; `conclusion_text` puts them into words."""

from __future__ import annotations

from dataclasses import dataclass

from calib.calibration.held_out import HeldOutTest
from calib.screening.smooth_motions import JointFault


@dataclass(frozen=True)
class AtPose:
    """A length at one pose."""

    pose: str  # id
    size_mm: float


@dataclass(frozen=True)
class Cause:
    """A missing effect as the arm shows it."""

    effect: str
    joints: tuple[int, ...]  # that carry it, counted from 1, the one that moves the tool the most first
    size: str  # of that joint, with its unit, in words
    largest: AtPose | None  # where it changes what is predicted the most
    noun: str = ""  # the effect in a sentence; one that ends in "joint" is followed by its number


@dataclass(frozen=True)
class HeldOutError:
    """The error of the test poses, where it is larger than noise would leave."""

    rmse_mm: float  # 3D
    noise_ratio: float  # it over what noise alone leaves


@dataclass(frozen=True)
class ResidualSummary:
    """What a fit leaves over, in a few words: the most definite of these that there is, else noise."""

    fault: JointFault | None
    inputs: tuple[str, ...]  # against which it has order
    too_large: bool
    outlier_poses: tuple[str, ...]
    held_out: HeldOutError | None = None


# ---- verdicts -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Adequate:
    """Nothing that these data can test is missing."""

    any_tested: bool
    untestable: tuple[str, ...]  # families, those apart that hardly any data can test
    held_out: HeldOutError | None = None
    left: AtPose | None = None  # the pose that is off the most


@dataclass(frozen=True)
class Named:
    """Effects were missing, and with them nothing else shows."""

    effects: tuple[str, ...]
    contradicting_points: int | None  # of test poses, that got worse within their scatter
    held_out: HeldOutError | None = None
    causes: tuple[Cause, ...] = ()  # one for each of the effects


@dataclass(frozen=True)
class Ambiguous:
    """One of several effects is missing."""

    effects: tuple[str, ...]  # that were named before
    tied: tuple[str, ...]
    suspected: tuple[str, ...] = ()  # effects that were added before and are not claimed
    left: AtPose | None = None  # where it shows the most
    joints: tuple[int, ...] = ()  # counted from 1, that carry it in the model


@dataclass(frozen=True)
class Unexplained:
    """Something is left that no effect of the catalogue explains."""

    effects: tuple[str, ...]  # that help, and are only suspected
    reason: str  # "data", "implausible", "curves", "fault", "order", "size", "wander", "promise" or "refused"
    doubt: str  # why points and poses do not belong together, for "data" and "implausible"
    left: AtPose | None = None  # the pose that is off the most, without learned curves
    joint: int | None = None  # counted from 1, whose motion shows what is left the most
    held_out: HeldOutTest | None = None  # the test poses against what the model promised
    refusal: str | None = None  # `Refusal.why` of an effect that was not added


@dataclass(frozen=True)
class Outliers:
    """Apart from single poses nothing is left."""

    effects: tuple[str, ...]  # that were missing
    poses: tuple[str, ...]  # ids
    left: AtPose | None = None  # the one that is off the most
    causes: tuple[Cause, ...] = ()


VerdictSentence = Adequate | Named | Ambiguous | Unexplained | Outliers
