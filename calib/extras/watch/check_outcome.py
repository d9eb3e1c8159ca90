"""What planned check poses achieve: the usual changes of a cell that they detect, and the reason for each pose."""

from __future__ import annotations

from dataclasses import dataclass

from calib.planning.outcome import Outcome, PoseReason

ChangeKey = tuple[str, int | None, str]  # `ChangeModel.key` of a change of the cell


@dataclass(frozen=True)
class ChangeReason(PoseReason):
    """Reason for a check pose: changes of the cell that would be detected less well without it."""

    changes: tuple[ChangeKey, ...]  # the largest loss first


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
class CheckOutcome(Outcome):
    """Usual changes of the cell that the planned check poses detect, with their detectable sizes."""

    changes: tuple[DetectableChange, ...]
