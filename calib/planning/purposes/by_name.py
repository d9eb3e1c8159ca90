"""A purpose by its name, that apart which needs a diagnosis."""

from __future__ import annotations

from calib.errors import CalibError
from calib.options import PLAN_CRITERIA
from calib.planning.purpose import CALIBRATION, WATCH, ForCalibration, Purpose
from calib.planning.purposes.effect_sizes import ForEffects
from calib.planning.purposes.watching import ForWatch


def purpose_of(words: str, criterion: str = "I", *, payload_kg: float | None = None) -> Purpose:
    """The purpose that --for names: "calibration", "watch", or effects with commas between, and a payload for them.

    Raises CalibError where it names none.
    """
    if criterion not in PLAN_CRITERIA:
        raise CalibError(f"no criterion {criterion!r}; there are {' and '.join(PLAN_CRITERIA)}")
    names = tuple(dict.fromkeys(name.strip() for name in words.split(",") if name.strip()))
    if len(names) == 1 and names[0] in (CALIBRATION, WATCH):
        if payload_kg is not None:
            raise CalibError(f"--payload-kg is for effects that a load shows; --for {words} is planned without")
        return ForWatch() if names[0] == WATCH else ForCalibration(criterion)
    if not names or {CALIBRATION, WATCH} & set(names):
        raise CalibError(f"--for {words}: give {CALIBRATION}, {WATCH}, or effects with commas between")
    if criterion != PLAN_CRITERIA[0]:
        raise CalibError(f"--criterion {criterion} is of a calibration; leave it out with --for {words}")
    return ForEffects(names, payload_kg)
