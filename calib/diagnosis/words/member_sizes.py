"""How large each member of a fitted effect is: its main value, and how far it moves what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.effects.effect import Effect, Parameter, full_name
from calib.fitting.observations import Observations, predict_points


@dataclass(frozen=True)
class MainValue:
    """The value of a member that tells most of it: the amplitude of several angles, else its surest parameter."""

    parameter: Parameter | None  # None: an amplitude
    name: str  # full, with the unit at its end
    value: float
    sigma: float
    unit: str


def main_value(member: Effect, calibration: Calibration) -> MainValue | None:
    """None where nothing of the member was fitted."""
    fit = calibration.fit
    fitted = {p.name: (float(x), float(s)) for p, x, s in zip(fit.parameters, fit.x, fit.sigma, strict=True)}
    known = [p for p in member.parameters if full_name(member, p) in fitted]
    if not known:
        return None
    values = [fitted[full_name(member, parameter)] for parameter in known]
    if len(known) > 1 and all(parameter.unit == "rad" for parameter in known):
        amplitude = float(np.sqrt(sum(value**2 for value, _ in values)))
        sigma = float(np.sqrt(sum((value * s) ** 2 for value, s in values))) / max(amplitude, 1e-300)
        prefix = full_name(member, known[0]).rpartition(".")[0]
        return MainValue(None, f"{prefix}.amplitude_rad", amplitude, sigma, "rad")
    surest = int(np.argmax([abs(value) / max(sigma, 1e-300) for value, sigma in values]))
    return MainValue(known[surest], full_name(member, known[surest]), *values[surest], known[surest].unit)


def moved_mm(members: Sequence[Effect], calibration: Calibration) -> list[float]:
    """How far each member by itself moves the measured points, rms about their mean."""
    model, x = calibration.model, calibration.fit.x
    names = [parameter.name for parameter in model.parameters]
    observed = Observations.of(calibration.fitted_dataset)
    with_all = predict_points(model, x, observed)

    def rms_mm(member: Effect) -> float:
        own = {full_name(member, parameter) for parameter in member.parameters}
        without = np.where([name in own for name in names], 0.0, x)
        shift: Array = with_all - predict_points(model, without, observed)
        return float(np.sqrt(np.mean(np.sum((shift - shift.mean(axis=0)) ** 2, axis=1))))

    return list(map(rms_mm, members))
