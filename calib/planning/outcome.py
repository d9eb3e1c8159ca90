"""Facts on planned poses: the reason for each, and the achievement of all for each design criterion."""

from __future__ import annotations

from dataclasses import dataclass

from calib.planning.simulated_pairs import Needed

ChangeKey = tuple[str, int | None, str]  # `ChangeModel.key` of a change of the cell


@dataclass(frozen=True)
class ParameterReason:
    """Reason for a pose: parameters that it determines better, and a joint taken far from its measured positions."""

    parameters: tuple[str, ...]  # without their symbols, the largest gain first
    far_joint: int | None  # from 1; None where each joint was measured near


@dataclass(frozen=True)
class ChangeReason:
    """Reason for a check pose: changes of the cell that would be detected less well without it."""

    changes: tuple[ChangeKey, ...]  # the largest loss first


@dataclass(frozen=True)
class SeparationReason:
    """Reason for a pose: the distance there between the predictions of the two least separated hypotheses."""

    separation_mm: float


@dataclass(frozen=True)
class PairReason:
    """Reason for a pose: it is measured under a changed condition, at the joints of another one."""

    again: str | None  # the pose measured before that it repeats; None where both are new
    condition: str  # column of poses.csv
    level: float | None  # its value; None for sides of approach


PoseReason = ParameterReason | ChangeReason | SeparationReason | PairReason


@dataclass(frozen=True)
class CoefficientSigma:
    """Sigma of one coefficient of an effect before and after the planned poses."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True)
class EffectOutcome:
    """Sigmas of the coefficients of suspected effects, and the conditions that the poses are measured under."""

    coefficients: tuple[CoefficientSigma, ...]  # in the model's order
    conditions: tuple[str, ...]  # fields of `Poses` that have to vary: "approach", "payload_kg", "temperature_c"
    unrecorded: tuple[str, ...]  # those of `conditions` that the measured poses have no values of


@dataclass(frozen=True)
class DetectableChange:
    """Least sizes of a usual change of the cell from which a verdict on it holds 19 times of 20."""

    key: ChangeKey
    unit: str
    size: float | None  # something is found to have changed; None: no pose shows the change
    scanner_free: bool  # whether it shows wherever the scanner stands
    named: float | None  # it is named and no other change, though others may be said to be as likely; None: never
    alone: float | None  # it is named, and nothing is said to be as likely; None: never
    rival: ChangeKey | None  # the change that looks most like it


@dataclass(frozen=True)
class CheckOutcome:
    """Usual changes of the cell that the planned check poses detect, with their detectable sizes."""

    changes: tuple[DetectableChange, ...]


@dataclass(frozen=True)
class DiscriminationOutcome:
    """Power with which the planned poses discriminate between hypotheses, and advice where it is low."""

    hypotheses: tuple[str, ...]
    power_by_count: tuple[float, ...]  # power of none, the first, the first two, ... of the poses
    equivalent: tuple[tuple[str, str], ...]  # pairs that no offered pose discriminates
    enough: int | None  # number of poses that reach `enough_power`, where these do not
    enough_power: float
    payload_kg: float | None  # a payload that would add power, where none was asked for
    confirm: tuple[tuple[str, str], ...]  # hypothesis and the experiment that shows it, where poses cannot
    untested: tuple[str, ...]  # hypotheses that the data cannot test
    would_help: str  # what would make these testable

    @property
    def power(self) -> float:
        """Probability that the planned poses discriminate the true hypothesis from all others."""
        return self.power_by_count[-1]


@dataclass(frozen=True)
class ProofOutcome:
    """A change of one condition, and the probability that pairs of poses then prove which hypothesis is true."""

    hypotheses: tuple[str, ...]
    condition: str  # column of poses.csv; "approach" for those of all joints
    before: float | None  # None for sides of approach
    after: float | None
    again: tuple[str, ...]  # measured poses to measure again; () where all are new
    assumed: bool  # whether no column has the condition of the measured poses, which is taken for `before`
    pairs: int
    power: float
    others: tuple[tuple[str, float | None, float | None, float], ...]
    """Other conditions with their values before and after, and nearly the probability that changing these reaches."""
    needed: tuple[Needed, ...] = ()  # what it takes to prove it more probably


Outcome = EffectOutcome | CheckOutcome | DiscriminationOutcome | ProofOutcome
