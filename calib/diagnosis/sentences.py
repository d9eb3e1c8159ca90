"""The sentences that a diagnosis and an advice consist of, as facts: kind, numbers, effects, poses, joints.

`calib.diagnosis.text` puts them into words. Whoever lays them out in another way (the page, the report) reads the
fields; a finished text is never cut.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.array_types import BoolArray
from calib.dataset.stands import ShotCount
from calib.diagnosis.pose_recommendation import DiscriminatingPose
from calib.fitting.tool_point.placement import ToolShift
from calib.screening.fault_models import JointFault
from calib.screening.scan_statistic import Channel

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
    shots: ShotCount | None = None  # of the whole dataset, where points are means over standing poses


@dataclass(frozen=True)
class FittedValue:
    """A parameter as it was fitted."""

    name: str
    value: float
    sigma: float
    unit: str
    meaning: str  # its consequence on this arm, "" where the value says it already


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
    explained_share: float  # of the leftover sum of squares
    p_value: float  # Holm-corrected
    runner_up: str  # the next candidate, "" where there was none
    lead: float | None  # over it, in log evidence
    change: ErrorChange | None
    values: tuple[FittedValue, ...]  # those known to better than half their size, the surest first
    note: str  # what the family assumes, such as unknown masses; "" where nothing


@dataclass(frozen=True)
class CurvesLearned:
    """What no named effect explains follows curves of the joints, which were learned."""

    effect: str
    joints: tuple[int, ...]  # counted from 1
    inputs: tuple[str, ...]
    formula: str | None
    log_evidence: float  # over noise alone
    change: ErrorChange | None


@dataclass(frozen=True)
class EffectsTied:
    """Effects that these data cannot tell apart, and what would."""

    effects: tuple[str, ...]
    best: str  # candidate
    overlaps: tuple[
        tuple[str, float], ...
    ]  # effect, share of what the best explains that it could explain too
    confirm: tuple[tuple[str, str], ...]  # effect, what to measure to see it alone
    poses: tuple[DiscriminatingPose, ...]
    is_revolute: BoolArray  # (n,) joints; of the poses' joint values


@dataclass(frozen=True)
class EffectRefused:
    """An effect that explains the training poses and makes the test poses worse."""

    effect: str


@dataclass(frozen=True)
class FaultLeads:
    """A fault outside the catalogue has more evidence than any effect, so none was named."""

    fault: JointFault
    margin: float  # in log evidence, that it leads by at least


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
class FaultSuspected:
    """What is left looks like a fault outside the catalogue."""

    fault: JointFault


@dataclass(frozen=True)
class PosesStandOut:
    """Single poses are off by more than noise."""

    poses: tuple[str, ...]  # ids


@dataclass(frozen=True)
class ResidualSummary:
    """What a fit leaves over, in a few words: the most definite of these that there is, else noise."""

    fault: JointFault | None
    inputs: tuple[str, ...]  # against which it has order
    too_large: bool
    outlier_poses: tuple[str, ...]


# ---- verdicts -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Adequate:
    """Nothing that these data can test is missing."""

    any_tested: bool
    untestable: tuple[str, ...]  # families, those apart that hardly any data can test


@dataclass(frozen=True)
class Named:
    """Effects were missing, and with them nothing else shows."""

    effects: tuple[str, ...]
    contradicting_points: int | None  # of test poses, that got worse within their scatter


@dataclass(frozen=True)
class Ambiguous:
    """One of several effects is missing."""

    effects: tuple[str, ...]  # that were named before
    tied: tuple[str, ...]


@dataclass(frozen=True)
class Unexplained:
    """Something is left that no effect of the catalogue explains."""

    effects: tuple[str, ...]  # that help
    reason: str  # "implausible", "curves", "fault", "order", "size" or "refused"
    doubt: str  # why points and poses do not belong together, for "implausible"


@dataclass(frozen=True)
class Outliers:
    """Apart from single poses nothing is left."""

    effects: tuple[str, ...]  # that were missing
    poses: tuple[str, ...]  # ids


# ---- advice ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LookAtJoint:
    """A fault of one joint has more evidence than any effect."""

    fault: JointFault


@dataclass(frozen=True)
class AddEffect:
    """One effect leads."""

    effect: str
    log_evidence: float
    lead: float | None  # over the next, in log evidence


@dataclass(frozen=True)
class AddCurves:
    """No effect of the ranking explains what is left, curves of the joints do."""

    effect: str
    joints: tuple[int, ...]  # counted from 1
    inputs: tuple[str, ...]
    log_evidence: float  # over noise alone


@dataclass(frozen=True)
class TellApart:
    """Several effects could each explain it."""

    effects: tuple[str, ...]


@dataclass(frozen=True)
class LookCloser:
    """Something is left that no effect in the ranking explains."""


@dataclass(frozen=True)
class MeasureAgain:
    """No effect is missing, single poses stand out."""


@dataclass(frozen=True)
class NothingToAdd:
    """No effect of the ranking would help."""

    any_tested: bool
    untestable: int  # families, those apart that hardly any data can test


VerdictSentence = Adequate | Named | Ambiguous | Unexplained | Outliers
AdviceSentence = (
    ResidualSummary
    | LookAtJoint
    | AddEffect
    | AddCurves
    | TellApart
    | LookCloser
    | MeasureAgain
    | NothingToAdd
)
ResidualSentence = (
    ResidualSize | ResidualOrder | ResidualWithoutOrder | ResidualTooLarge | FaultSuspected | PosesStandOut
)
Reason = (
    ModelFitted
    | ToolShift
    | EffectFound
    | CurvesLearned
    | EffectsTied
    | EffectRefused
    | FaultLeads
    | ResidualSentence
)


@dataclass(frozen=True)
class Explanation:
    """Why a verdict was reached, in paragraphs, and the verdict."""

    reasons: tuple[tuple[Reason, ...], ...]
    verdict: VerdictSentence
