"""The sentences that led to a verdict, as facts: kind, numbers, effects, poses, joints.

`text` puts them into words. Whoever lays them out in another way (the page, the report) reads the
fields; a finished text is never cut.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.array_types import Array, BoolArray
from calib.dataset.repeats import RepeatCount
from calib.diagnosis.words.conclusions import VerdictSentence
from calib.diagnosis.words.noise_text import NoiseShaped as NoiseShaped
from calib.effects.effect import NaturalBound
from calib.fitting.tool_point import ToolShift as ToolShift
from calib.screening.scan_statistic import Channel
from calib.screening.smooth_motions import JointFault

SMALL_CHANGE = 0.03  # share of the test poses' error below which a change of it counts for nothing


@dataclass(frozen=True)
class ModelFitted:
    """Which model the diagnosis began with, and how far it is from the measurements."""

    robot: str
    families: tuple[str, ...]  # in the model beside the link errors
    points: int  # measured at training poses
    sigma_mm: float  # of a residual's coordinate
    noise_ratio: float | None  # sigma over the declared one; None where no noise is declared
    train_rmse_mm: float | None  # 3D; None where there are no test poses to compare with
    test_rmse_mm: float | None
    repeats: RepeatCount | None = None  # of the whole dataset, where points are means over repeat groups
    instrument: str = "scanner"  # what measured: "scanner", or "instrument" where no jig with faces was measured


@dataclass(frozen=True)
class DataWrong:
    """Joints, points or the robot's table are wrong, so that no effect is looked for."""

    words: str  # what is wrong, by which figures, and the mend


@dataclass(frozen=True)
class FittedValue:
    """A parameter as it was fitted."""

    name: str
    value: float
    sigma: float
    unit: str
    meaning: str  # its consequence on this arm, "" where the value says it already
    bound: NaturalBound | None = None  # that it exceeds


@dataclass(frozen=True)
class ErrorChange:
    """A 3D RMSE before and after an effect was added."""

    of_test_poses: bool
    before_mm: float
    after_mm: float


@dataclass(frozen=True)
class EffectFound:
    """An effect that was added, the case for it and what it came to."""

    effect: str
    standing: str  # "claimed", "suspected", or "open": it stands for a set
    explained_share: float  # of the leftover sum of squares
    p_value: float  # Holm-corrected
    runner_up: str  # the next candidate, "" where there was none
    lead: float | None  # over it, in log evidence
    change: ErrorChange | None
    values: tuple[FittedValue, ...]  # those known to better than half their size, the surest first
    note: str  # what the family assumes, such as unknown masses; "" where nothing
    visible_mm: float | None = None  # rms over the training poses of what it explains, and link errors do not
    left_to_curves: tuple[str, ...] = ()  # above it in the ranking, but smooth curves say clearly more than they


@dataclass(frozen=True)
class CurvesLearned:
    """What no named effect explains follows curves of the joints, which were learned."""

    effect: str
    joints: tuple[int, ...]  # counted from 1
    inputs: tuple[str, ...]
    formula: str | None
    log_evidence: float | None  # over noise alone; None where a saved session brought the curves
    change: ErrorChange | None


@dataclass(frozen=True)
class SetOpen:
    """An effect in the model stands for a set that these data cannot tell apart."""

    effect: str
    twins: tuple[str, ...]  # that make the same of these poses
    untested: tuple[str, ...]  # that the data lack the means to tell from it
    would_help: str  # for those, "" where there are none
    confirm: tuple[tuple[str, str], ...]  # effect, what to measure to see it alone; of the effect and its twins


@dataclass(frozen=True)
class DiscriminatingPose:
    """A pose to measure next, and the least difference between any two hypotheses there."""

    q: Array  # (n,) rad or mm, as it is commanded
    separation_mm: float  # of the tool, beyond what a refit at this pose absorbs


@dataclass(frozen=True)
class EffectsTied:
    """Effects that these data cannot tell apart, and what would."""

    effects: tuple[str, ...]
    best: str  # candidate
    overlaps: tuple[tuple[str, float], ...]  # effect, share of what the best explains that it could explain too
    confirm: tuple[tuple[str, str], ...]  # effect, what to measure to see it alone
    poses: tuple[DiscriminatingPose, ...]
    is_revolute: BoolArray  # (n,) joints; of the poses' joint values
    next_poses: int = 0  # how many are advised
    power: float | None = None  # probability that all of them tell the effects apart


@dataclass(frozen=True)
class EffectRefused:
    """An effect that explains the training poses, and what speaks against it."""

    effect: str
    why: str  # "nature", "test poses" or "no gain"
    detail: str = ""  # for "nature": what is beyond which bound, as a clause


@dataclass(frozen=True)
class ResidualSize:
    """How large the residual is, and the noise that it was compared with."""

    residual_mm: float  # sigma of a coordinate
    noise_mm: float
    noise_from: str  # "repeats", "dataset" or "fit"


@dataclass(frozen=True)
class ResidualOrder:
    """The residual has order against some inputs."""

    inputs: tuple[str, ...]  # the most first
    p_value: float  # of the first
    channel: Channel  # in what the first shows most: an axis, or the motion of a joint


@dataclass(frozen=True)
class ResidualWithoutOrder:
    """The residual has no order against any input."""

    inputs: int
    closest: str
    p_value: float


@dataclass(frozen=True)
class ResidualTooLarge:
    """More than noise is left."""


@dataclass(frozen=True)
class MassesOff:
    """A part of what is left follows from masses that differ from robot.toml, and was allowed for."""

    log_evidence: float


@dataclass(frozen=True)
class FaultSuspected:
    """What is left looks like a fault outside the catalogue."""

    fault: JointFault


@dataclass(frozen=True)
class PosesStandOut:
    """Single poses are off by more than noise."""

    poses: tuple[str, ...]  # ids


ResidualSentence = (
    ResidualSize
    | MassesOff
    | NoiseShaped
    | ResidualOrder
    | ResidualWithoutOrder
    | ResidualTooLarge
    | FaultSuspected
    | PosesStandOut
)
Reason = (
    ModelFitted
    | DataWrong
    | ToolShift
    | EffectFound
    | CurvesLearned
    | SetOpen
    | EffectsTied
    | EffectRefused
    | ResidualSentence
)


@dataclass(frozen=True)
class Explanation:
    """Why a verdict was reached, in paragraphs, and the verdict."""

    reasons: tuple[tuple[Reason, ...], ...]
    verdict: VerdictSentence
