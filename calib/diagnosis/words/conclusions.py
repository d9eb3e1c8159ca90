"""The verdict of a diagnosis and the advice on a model, as facts; `conclusion_text` puts them into words."""

from __future__ import annotations

from dataclasses import dataclass

from calib.diagnosis.words.noise_text import NoiseShaped
from calib.screening.fault_models import JointFault


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
    test_excess: float | None = None  # the test poses' error over what noise leaves there, where it is larger


@dataclass(frozen=True)
class Named:
    """Effects were missing, and with them nothing else shows."""

    effects: tuple[str, ...]
    contradicting_points: int | None  # of test poses, that got worse within their scatter
    test_excess: float | None = None  # as of `Adequate`


@dataclass(frozen=True)
class Ambiguous:
    """One of several effects is missing."""

    effects: tuple[str, ...]  # that were named before
    tied: tuple[str, ...]
    suspected: tuple[str, ...] = ()  # effects that were added before and are not claimed


@dataclass(frozen=True)
class Unexplained:
    """Something is left that no effect of the catalogue explains."""

    effects: tuple[str, ...]  # that help, and are only suspected
    reason: str  # "implausible", "curves", "fault", "order", "size", "wander" or "refused"
    doubt: str  # why points and poses do not belong together, for "implausible"


@dataclass(frozen=True)
class Outliers:
    """Apart from single poses nothing is left."""

    effects: tuple[str, ...]  # that were missing
    poses: tuple[str, ...]  # ids


# ---- advice ---------------------------------------------------------------------------------------------------------


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
class RemoveEffect:
    """An effect is superfluous: the others explain what it does."""

    effect: str


@dataclass(frozen=True)
class LeaveOut:
    """Without a few poses that stand out nothing is left over."""

    poses: tuple[str, ...]  # ids
    effects: tuple[str, ...]  # in the model that is found without them


@dataclass(frozen=True)
class WeighNoise:
    """With the points weighed by the shape of the noise nothing is left over."""

    noise: NoiseShaped
    effects: tuple[str, ...]  # in the model that is found with it


VerdictSentence = Adequate | Named | Ambiguous | Unexplained | Outliers
AdviceSentence = ResidualSummary | AddEffect | AddCurves | RemoveEffect | LeaveOut | WeighNoise
