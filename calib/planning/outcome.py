"""What planned poses achieve, as facts: why each was chosen, and what all of them do for the design criterion."""

from __future__ import annotations

from dataclasses import dataclass

ChangeKey = tuple[str, int | None, str]  # `ChangeModel.key` of a change of the cell


@dataclass(frozen=True)
class ParameterReason:
    """Parameters that are known better by a pose, and a joint that was never measured near its position there."""

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
    """How well the coefficients of suspected effects become known, and which conditions that takes."""

    coefficients: tuple[CoefficientSigma, ...]  # in the model's order
    conditions: tuple[str, ...]  # fields of `Poses` that have to vary: "approach", "payload_kg", "temperature_c"
    unrecorded: tuple[str, ...]  # those of `conditions` that the measured poses have no values of


@dataclass(frozen=True)
class DetectableChange:
    """Size from which on a usual change of the cell is detected and named 19 times of 20."""

    key: ChangeKey
    unit: str
    size: float | None  # None: no pose shows it
    scanner_free: bool  # whether that holds wherever the scanner stands now


@dataclass(frozen=True)
class CheckOutcome:
    """The usual changes of the cell that check poses detect."""

    changes: tuple[DetectableChange, ...]


@dataclass(frozen=True)
class DiscriminationOutcome:
    """How surely hypotheses are discriminated, and what would help where that is not sure enough."""

    hypotheses: tuple[str, ...]
    power_by_count: tuple[float, ...]  # with none, the first, the first two, ... of the poses
    equivalent: tuple[tuple[str, str], ...]  # pairs that no such pose discriminates
    enough: int | None  # such poses that have the power `enough_power`, where these have less
    enough_power: float
    payload_kg: float | None  # a payload that would add power, where none was asked for
    confirm: tuple[tuple[str, str], ...]  # hypothesis and how it is shown by itself, where poses cannot
    untested: tuple[str, ...]  # hypotheses that the data cannot test
    would_help: str  # what would make these testable


Outcome = EffectOutcome | CheckOutcome | DiscriminationOutcome
