"""Learned curves of a fit over their inputs, with their uncertainty: for figures and in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray
from calib.calibration.result import Calibration
from calib.dataset.input_names import input_unit
from calib.effects.effect import full_name
from calib.screening.curves.smooth_joint_error import (
    CouplingModes,
    FormulaModes,
    FormulaTerm,
    SmoothJointError,
    factor_of,
    formula_text,
    input_values,
)
from calib.statistics import rms

_PLACES = 401  # at which a curve is computed
_BEYOND = 0.12  # of the measured range, on either side


@dataclass(frozen=True, eq=False)
class FittedCurve:
    """Fitted curve of one joint, at G places of its input."""

    joint: int  # from 0
    is_revolute: bool  # whether the joint turns
    input: str
    input_unit: str  # as people read it: deg, mm, Nm, C, s, kg; "" for a column of the user's own
    u: Array  # (G,) rad, mm, Nm, as the input is
    value: Array  # (G,) rad (mm for a prismatic joint)
    sigma: Array  # (G,) of the value, by the fit's covariance
    measured: Array  # (N,) inputs of the training poses, sorted
    rms: float  # of the value, over the training poses
    known: int  # number of parameters that the data determine to better than half their prior sigma
    parameters: int  # number of parameters
    formula: str | None  # with values, where the curve is a short formula
    shape: str = ""  # the formula's terms in words; "" without a formula
    peak: float | None = None  # place of the peak, where the formula is one bump
    factor: str = ""  # input that multiplies the curve, which is given at that input's usual size; "" for none
    factor_size: float = 1.0

    @property
    def unit(self) -> str:
        """Unit of the curve for readers."""
        return "mrad" if self.is_revolute else "mm"

    @property
    def scale(self) -> float:
        """Factor from values of the curve to its `unit`."""
        return 1e3 if self.is_revolute else 1.0

    @property
    def input_scale(self) -> float:
        """Factor from values of the input to its `input_unit`."""
        return 180.0 / np.pi if self.input_unit == "deg" else 1.0

    @property
    def inside(self) -> BoolArray:
        """Mask (G,) of the places that lie within the measured range of the input."""
        return (self.u >= self.measured[0]) & (self.u <= self.measured[-1])

    @property
    def largest(self) -> tuple[float, float]:
        """Input value within the measured range at which the curve is largest, and the curve's value there."""
        if self.peak is not None and self.measured[0] <= self.peak <= self.measured[-1]:
            return self.peak, float(np.interp(self.peak, self.u, self.value))
        at = int(np.argmax(np.where(self.inside, np.abs(self.value), -1.0)))
        return float(self.u[at]), float(self.value[at])


def learned_members(calibration: Calibration) -> tuple[SmoothJointError, ...]:
    """Learned curves (each an effect on one joint) in a fit's model; () where there are none."""
    return tuple(e for e in calibration.model.added_effects if isinstance(e, SmoothJointError))


def members_of_one_input(calibration: Calibration) -> tuple[SmoothJointError, ...]:
    """Learned curves of a fit's model that can be drawn over one input: all but couplings of all joints."""
    return tuple(one for one in learned_members(calibration) if not isinstance(one.modes, CouplingModes))


def fitted_curves(calibration: Calibration) -> tuple[FittedCurve, ...]:
    """Fitted curves of the learned curves in a fit's model, but couplings of all joints; () where there are none."""
    members = members_of_one_input(calibration)
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
        assert not isinstance(member.modes, CouplingModes)
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
            input_unit=input_unit(member.modes.input, model.robot),
            u=u,
            value=modes @ fit.x[own],
            sigma=np.sqrt(np.maximum(variance, 0.0)),
            measured=measured,
            rms=rms(member.joint_motions(state)[training] @ fit.x[own]),
            known=int(np.count_nonzero(fit.sigma[own] < 0.5 * np.array(member.prior_sigma_rad))),
            parameters=len(own),
            formula=formula_text([member], values),
            shape=shape_text(member, calibration),
            peak=_peak(member),
            factor=factor_of(member.modes),
            factor_size=member.modes.factor_size if isinstance(member.modes, FormulaModes) else 1.0,
        )
        out.append(curve)
    return tuple(out)


def shape_text(member: SmoothJointError, calibration: Calibration) -> str:
    """Terms of a short formula in words, as in "a bump at 29 deg, 12 deg wide"; "" for a curve without a formula.

    They are the same before and after a fit, which finds the sizes of the terms and not their places.
    """
    modes = member.modes
    if not isinstance(modes, FormulaModes):
        return ""
    unit = input_unit(modes.input, calibration.model.robot)
    scale = 180.0 / np.pi if unit == "deg" else 1.0

    def in_words(term: FormulaTerm) -> str:
        place = f"{scale * term.place:.3g} {unit}".rstrip()
        return {
            "harmonic": f"a wave, {term.order} a turn",
            "bump": f"a bump at {place}, {scale * term.width:.2g} {unit}".rstrip() + " wide",
            "kink": f"a kink at {place}",
            "hinge": f"a slope from {place} on",
            "line": "a slope",
            "root": f"a root from {place}",
            "step": f"a step at {place}",
            "square": "a part that grows with the square",
        }[term.kind]

    return ", ".join(map(in_words, modes.terms))


def _peak(member: SmoothJointError) -> float | None:
    terms = member.modes.terms if isinstance(member.modes, FormulaModes) else ()
    return terms[0].place if len(terms) == 1 and terms[0].kind == "bump" else None
