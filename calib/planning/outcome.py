"""Facts on planned poses: the reason for each, and the achievement of all for each design criterion."""

from __future__ import annotations

from dataclasses import dataclass

ChangeKey = tuple[str, int | None, str]  # `ChangeModel.key` of a change of the cell


@dataclass(frozen=True)
class ParameterReason:
    """Parameters that a pose makes known better, and a joint that was never measured near its position at that pose."""

    parameters: tuple[str, ...]  # without their symbols, the largest gain first
    far_joint: int | None  # from 1; None where each joint was measured near


@dataclass(frozen=True)
class ChangeReason:
    """Changes of the cell that would be detected less well without a pose."""

    changes: tuple[ChangeKey, ...]  # the largest loss first


@dataclass(frozen=True)
class SeparationReason:
    """Distance between the predictions of the two least separated hypotheses at a pose, both refitted."""

    separation_mm: float


PoseReason = ParameterReason | ChangeReason | SeparationReason


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
    """Size from which on a usual change of the cell is detected and named 19 times of 20."""

    key: ChangeKey
    unit: str
    size: float | None  # None: no pose shows the change
    scanner_free: bool  # whether that holds wherever the scanner stands


@dataclass(frozen=True)
class CheckOutcome:
    """The usual changes of the cell that check poses detect."""

    changes: tuple[DetectableChange, ...]


@dataclass(frozen=True)
class DiscriminationOutcome:
    """Power with which poses discriminate between hypotheses, and what would help where it is low."""

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
        """Probability that the true hypothesis is discriminated from the others with all of the poses."""
        return self.power_by_count[-1]


Outcome = EffectOutcome | CheckOutcome | DiscriminationOutcome
