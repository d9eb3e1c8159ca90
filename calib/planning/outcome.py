"""Facts on planned poses: the reason for each, and the achievement of all for each design criterion."""

from __future__ import annotations

from dataclasses import dataclass


class PoseReason:
    """Base of reasons for which a pose is planned; `calib.present.moves.plans.reason_told` tells each kind."""


class Outcome:
    """Base of what poses achieve beyond the predicted error; `calib.present.moves.plans.told` tells each kind."""

    @property
    def power(self) -> float | None:
        """Probability that it is told which of some hypotheses is true; None where there are none."""
        return None


@dataclass(frozen=True)
class ParameterReason(PoseReason):
    """Reason for a pose: parameters that it determines better, and a joint taken far from its measured positions."""

    parameters: tuple[str, ...]  # without their symbols, the largest gain first
    far_joint: int | None  # from 1; None where each joint was measured near


@dataclass(frozen=True)
class SeparationReason(PoseReason):
    """Reason for a pose: the distance there between the predictions of the two least separated hypotheses."""

    separation_mm: float


@dataclass(frozen=True)
class CoefficientSigma:
    """Sigma of one coefficient of an effect before and after the planned poses."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True)
class EffectOutcome(Outcome):
    """Sigmas of the coefficients of suspected effects, and the conditions that the poses are measured under."""

    coefficients: tuple[CoefficientSigma, ...]  # in the model's order
    conditions: tuple[str, ...]  # fields of `Poses` that have to vary: "approach", "payload_kg", "temperature_c"
    unrecorded: tuple[str, ...]  # those of `conditions` that the measured poses have no values of


@dataclass(frozen=True)
class DiscriminationOutcome(Outcome):
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
