"""Purposes that poses are planned for, by their words; nothing slow is imported, as `plan --help` lists them."""

from __future__ import annotations

from dataclasses import dataclass

from calib.plugins import contributions

CALIBRATION = "calibration"
SPLIT = "split"
FURTHER = 5  # poses to plan beyond a dataset where no number is given


@dataclass(frozen=True)
class PlanPurpose:
    """Something that poses are planned for: either from any fit by `criterion`, or from a diagnosis by `of_diagnosis`.

    A place is "module:name", imported when it is first used.
    """

    name: str  # the word of `plan --for`
    words: str  # what the page's list calls it
    help: str  # of the word, for `plan --help`
    criterion: str = ""  # place of a `DesignCriterion` that is made without arguments
    usual_count: int = FURTHER  # of poses, where none is given
    of_diagnosis: str = (
        ""  # place of a function (diagnosis, payload_kg, count or None) -> `calib.planning.criterion.PlanTask`
    )
    why_no_candidates: str = ""  # clause on why no table of candidates can be given; "" where one can
    advice: str = ""  # place of a function from a diagnosis to a result that `plan` would bring about, or None


_OWN = (
    PlanPurpose(
        CALIBRATION,
        "a smaller error",
        "calibration (default)",
        criterion="calib.planning.criterion:ForCalibration",
    ),
    PlanPurpose(
        SPLIT,
        "settle what the diagnosis left open",
        "split (settle a set that a diagnosis left open)",
        of_diagnosis="calib.planning.discrimination:task_of_confounded",
    ),
)


def purposes() -> dict[str, PlanPurpose]:
    """All purposes by name, those of plug-ins last; beside them poses are planned for effects."""
    return {purpose.name: purpose for purpose in (*_OWN, *contributions(PlanPurpose))}
