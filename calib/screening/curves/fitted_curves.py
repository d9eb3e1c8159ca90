"""The learned curves of a fit over their inputs, with their uncertainty: to be drawn, and to be told in a line each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from calib.array_types import Array, BoolArray
from calib.calibration.result import Calibration
from calib.dataset.input_names import joint_input, summed_joints
from calib.effects.effect import full_name
from calib.screening.curves.effect_file import formula_text
from calib.screening.curves.smooth_joint_error import (
    LEARNED,
    FormulaModes,
    FormulaTerm,
    SmoothJointError,
    input_values,
)

_PLACES = 401  # at which a curve is worked out
_BEYOND = 0.12  # of the measured range, on either side


@dataclass(frozen=True, eq=False)
class FittedCurve:
    """One joint's curve as it was fitted, at G places of its input."""

    joint: int  # from 0
    is_revolute: bool  # the joint
    input: str
    input_unit: str  # as people read it: deg, mm, Nm, C, s, kg; "" for a column of the user's own
    u: Array  # (G,) rad, mm, Nm, as the input is
    value: Array  # (G,) rad (mm for a prismatic joint)
    sigma: Array  # (G,) of the value, by the fit's covariance
    measured: Array  # (N,) inputs of the training poses, sorted
    rms: float  # over those
    known: int  # parameters that the data know to better than half their prior sigma
    parameters: int
    formula: str | None  # where it is a short formula
    shape: str = ""  # its terms in words, where it is one
    peak: float | None = None  # of the input, where it is one bump

    @property
    def unit(self) -> str:
        """The curve's unit as people read it."""
        return "mrad" if self.is_revolute else "mm"

    @property
    def scale(self) -> float:
        """By which values of the curve become its `unit`."""
        return 1e3 if self.is_revolute else 1.0

    @property
    def input_scale(self) -> float:
        """By which values of the input become its `input_unit`."""
        return 180.0 / np.pi if self.input_unit == "deg" else 1.0

    @property
    def inside(self) -> BoolArray:
        """(G,) whether a place lies within the measured range."""
        return np.asarray((self.u >= self.measured[0]) & (self.u <= self.measured[-1]))

    @property
    def largest(self) -> tuple[float, float]:
        """Where in the measured range the curve is largest, and what it is there."""
        if self.peak is not None and self.measured[0] <= self.peak <= self.measured[-1]:
            return self.peak, float(np.interp(self.peak, self.u, self.value))
        at = int(np.argmax(np.where(self.inside, np.abs(self.value), -1.0)))
        return float(self.u[at]), float(self.value[at])


def learned_members(calibration: Calibration) -> tuple[SmoothJointError, ...]:
    """The learned curves in a fit's model; () where there are none."""
    return tuple(e for e in calibration.model.added_effects if isinstance(e, SmoothJointError))


def fitted_curves(calibration: Calibration) -> tuple[FittedCurve, ...]:
    """The learned curves in a fit's model, as they were fitted; () where there are none."""
    members = learned_members(calibration)
    if not members:
        return ()
    fit, model = calibration.fit, calibration.model
    state = model.state(fit.x, calibration.dataset.poses)
    at = {p.name: i for i, p in enumerate(fit.parameters)}
    values = dict(zip(at, fit.x.tolist(), strict=True))
    after = calibration.after
    training = np.unique(after.pose[~after.is_test[after.pose]])
    out = []
    for member in members:
        own = [at[full_name(member, p)] for p in member.parameters]
        measured = np.sort(input_values(state, member.modes.input)[training])
        beyond = _BEYOND * (measured[-1] - measured[0])
        u = np.linspace(measured[0] - beyond, measured[-1] + beyond, _PLACES)
        modes = member.modes.at(u)
        variance = np.einsum("gk,kl,gl->g", modes, fit.covariance[np.ix_(own, own)], modes)
        curve = FittedCurve(
            joint=member.joint,
            is_revolute=model.robot.joints[member.joint].is_revolute,
            input=member.modes.input,
            input_unit=_input_unit(member.modes.input, calibration),
            u=u,
            value=modes @ fit.x[own],
            sigma=np.sqrt(np.maximum(variance, 0.0)),
            measured=measured,
            rms=float(np.sqrt(np.mean((member.modes.at(measured) @ fit.x[own]) ** 2))),
            known=int(np.count_nonzero(fit.sigma[own] < 0.5 * np.array(member.prior_sigma_rad))),
            parameters=len(own),
            formula=formula_text([member], values),
            shape=shape_text(member, calibration),
            peak=_peak(member),
        )
        out.append(curve)
    return tuple(out)


def shape_text(member: SmoothJointError, calibration: Calibration) -> str:
    """ "a bump at 29 deg, 12 deg wide": the terms of a short formula; "" of a curve that has none.

    The same before and after it is fitted: the fit finds the sizes of the terms, not their places.
    """
    modes = member.modes
    if not isinstance(modes, FormulaModes):
        return ""
    unit = _input_unit(modes.input, calibration)
    scale = 180.0 / np.pi if unit == "deg" else 1.0

    def told(term: FormulaTerm) -> str:
        place = f"{scale * term.place:.3g} {unit}".rstrip()
        return {
            "harmonic": f"a wave, {term.order} a turn",
            "bump": f"a bump at {place}, {scale * term.width:.2g} {unit}".rstrip() + " wide",
            "kink": f"a kink at {place}",
            "step": f"a step at {place}",
            "square": "a part that grows with the square",
        }[term.kind]

    return ", ".join(map(told, modes.terms))


def _peak(member: SmoothJointError) -> float | None:
    terms = member.modes.terms if isinstance(member.modes, FormulaModes) else ()
    return terms[0].place if len(terms) == 1 and terms[0].kind == "bump" else None


def without_curves(parameters: pd.DataFrame) -> pd.DataFrame:
    """The rows of a table of parameters (column `name`) that are no learned curve's."""
    return parameters[~parameters["name"].str.startswith(f"{LEARNED}.")]


def _input_unit(name: str, calibration: Calibration) -> str:
    of_joint = joint_input(name)
    if of_joint is None:  # sums are of angles only
        units = {"temperature_c": "C", "time_s": "s", "payload_kg": "kg"}
        return units.get(name, "" if summed_joints(name) is None else "deg")
    quantity, joint = of_joint
    if quantity == "torque":
        return "Nm"
    return "deg" if calibration.model.robot.joints[joint].is_revolute else "mm"
