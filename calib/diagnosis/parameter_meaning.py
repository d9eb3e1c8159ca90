"""What the size of a parameter means on the arm: in its effect's own words, else by its unit."""

from __future__ import annotations

import numpy as np

from calib.calibration.result import Calibration
from calib.effects.compliance import stiffness
from calib.effects.effect import Effect, Parameter, has_meaning, meaning_of


def meaning(effect: Effect, parameter: Parameter, size: float, calibration: Calibration) -> str:
    """The consequence of a parameter in words, at this dataset's poses; "" where its value says it already.

    Args:
        effect: whose parameter it is.
        parameter: one of the effect's.
        size: in the parameter's unit.
        calibration: whose poses, torques and times it acts at.
    """
    if not np.isfinite(size) or size == 0.0:
        return ""
    if has_meaning(effect):
        state = calibration.model.state(calibration.fit.x, calibration.dataset.poses)
        return meaning_of(effect, parameter, size, state)
    unit = parameter.unit
    if unit == "rad":
        return f"{np.degrees(size):.2g}\N{DEGREE SIGN}"
    if unit == "rad/Nm":
        return stiffness(size)
    if unit == "1/K":
        return f"{size * 1e6:.2g} \N{MICRO SIGN}m a metre and kelvin"
    if unit in ("mm/s", "rad/s"):
        return _over_the_run(size, unit, calibration)
    return f"{100.0 * size:.2g} %" if unit == "1" else ""


def _over_the_run(size: float, unit: str, calibration: Calibration) -> str:
    time_s = calibration.dataset.poses.time_s
    hours = float(np.ptp(time_s)) / 3600.0 if time_s is not None else 0.0
    if hours <= 0.0:
        return ""
    moved = size * 3600.0 * hours
    words = f"{moved:.2g} mm" if unit == "mm/s" else f"{np.degrees(moved):.2g}\N{DEGREE SIGN}"
    return f"{words} over the {hours:.2g} h measured"
