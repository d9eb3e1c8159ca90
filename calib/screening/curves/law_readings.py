"""Readings of the laws in a fit: form, size with its sigma and bounds, and the poses that would refute each.

A law makes a forecast that a curve does not: what a motion of single joints changes, and what leaves it as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.array_types import Array, IndexArray
from calib.calibration.result import Calibration
from calib.dataset.input_names import history_input, input_unit, joint_input, quantity_of, summed_joints
from calib.effects.effect import full_name
from calib.effects.state import RobotState
from calib.fitting.model import point_by_state
from calib.screening.curves.fitted_curves import learned_members
from calib.screening.curves.laws import law_kind
from calib.screening.curves.readings import Sweep, sweep_over
from calib.screening.curves.smooth_joint_error import (
    LAW_BOUNDS,
    FormulaModes,
    SmoothJointError,
    formula_text,
    input_values,
)
from calib.statistics import rms

_SIGMAS_95 = 1.96
_OVER_A_WIDTH = ("line", "hinge", "root")  # terms of which the size counts after a usual way of the input
_PLACES = 801  # at which a law is evaluated over its input


@dataclass(frozen=True)
class Refutation:
    """Motion that shows whether a law holds, with the change that it forecasts."""

    sweep: Sweep | None  # of one joint alone; None where poses alone are to be measured again
    at_poses: tuple[str, ...]  # ids: as what the other joints stand, one time after the other
    forecast: float  # rad (mm for a prismatic joint): change of the joint's error that the law makes of it
    forecast_mm: float  # the same at the tool


@dataclass(frozen=True)
class InputValue:
    """Value of an input at which a law has the size that is told."""

    input: str
    value: float  # rad, mm, Nm, s, as the input is
    unit: str  # as people read it: deg, mm, Nm, s, C


@dataclass(frozen=True)
class LawReading:
    """What a learned law says, with numbers."""

    joint: int  # from 1
    kind: str  # of `laws.LAW_KINDS`
    input: str
    factor: str  # input that multiplies it; "" for none
    other_joints: tuple[int, ...]  # from 1: those beside its own of which its inputs are
    waves_per_turn: tuple[int, ...]
    terms: tuple[str, ...]  # kinds of its terms: harmonic, line, bump ...
    place: float | None  # of a bump, kink, hinge, step or root: rad, mm, Nm, as the input is
    size: float  # rad (mm for a prismatic joint): amplitude of one term, rms over the training poses of several
    sigma: float
    low: float  # 95 % bounds of the size
    high: float
    bound: float  # rad, that no such error exceeds
    is_revolute: bool
    at: tuple[InputValue, ...]  # usual values of its inputs, at which it has that size; () of a wave alone
    tool_mm: float  # rms displacement that it makes at the tool over the training poses
    formula: str
    refuted_by: Refutation


@lru_cache(maxsize=4)
def law_readings(calibration: Calibration) -> tuple[LawReading, ...]:
    """Readings of all laws in a fit's model; () where there are none."""
    members = [(one, one.modes) for one in learned_members(calibration) if isinstance(one.modes, FormulaModes)]
    if not members:
        return ()
    state = calibration.model.state(calibration.fit.x, calibration.dataset.poses)
    after = calibration.after
    training = np.unique(after.pose[~after.is_test[after.pose]])
    return tuple(_reading(member, modes, state, training, calibration) for member, modes in members)


def _reading(
    member: SmoothJointError, modes: FormulaModes, state: RobotState, training: IndexArray, calibration: Calibration
) -> LawReading:
    fit, joint = calibration.fit, member.joint
    at = {p.name: i for i, p in enumerate(fit.parameters)}
    own = [at[full_name(member, p)] for p in member.parameters]
    amounts, covariance = fit.x[own], fit.covariance[np.ix_(own, own)]
    motions = member.joint_motions(state)[training]
    moved = motions @ amounts
    size, sigma = _size(modes, amounts, covariance, motions)
    lever_mm = _lever_mm(state, joint)[training]
    placed = [term.place for term in modes.terms if term.kind not in ("harmonic", "line", "square")]
    values = dict(zip(at, fit.x.tolist(), strict=True))
    return LawReading(
        joint=joint + 1,
        kind=law_kind(joint, modes),
        input=modes.input,
        factor=modes.factor,
        other_joints=tuple(k + 1 for k in _joints_of(modes) if k != joint),
        waves_per_turn=tuple(term.order for term in modes.terms if term.kind == "harmonic"),
        terms=tuple(term.kind for term in modes.terms),
        place=placed[0] if placed else None,
        size=size,
        sigma=sigma,
        low=size - _SIGMAS_95 * sigma,
        high=size + _SIGMAS_95 * sigma,
        bound=LAW_BOUNDS[0].size,
        is_revolute=state.robot.joints[joint].is_revolute,
        at=_usual_values(modes, calibration),
        tool_mm=rms(lever_mm * moved),
        formula=formula_text([member], values) or "",
        refuted_by=_refutation(member, modes, amounts, state, training, rms(lever_mm)),
    )


def _usual_values(modes: FormulaModes, calibration: Calibration) -> tuple[InputValue, ...]:
    """Values of factor and input at which a law has its size: none of a side's, nor of the input of a wave."""
    values = [(modes.factor, modes.factor_size)] if modes.factor else []
    if len(modes.terms) == 1 and modes.terms[0].kind in _OVER_A_WIDTH:
        values.append((modes.input, modes.terms[0].width))
    told = (InputValue(name, value, input_unit(name, calibration.model.robot)) for name, value in values)
    return tuple(one for one in told if one.unit)


def _size(modes: FormulaModes, amounts: Array, covariance: Array, motions: Array) -> tuple[float, float]:
    """Size of a law, with sign where it is one number, and its sigma by the fit's covariance."""
    if len(modes.terms) == 1 and len(amounts) == 1:
        return float(amounts[0]), float(np.sqrt(max(covariance[0, 0], 0.0)))
    if len(modes.terms) == 1:  # amplitude of a wave
        size = float(np.linalg.norm(amounts))
        slope = amounts / max(size, 1e-300)
    else:
        moved = motions @ amounts
        size = rms(moved)
        slope = motions.T @ moved / (len(moved) * max(size, 1e-300))
    return size, float(np.sqrt(max(float(slope @ covariance @ slope), 0.0)))


def _lever_mm(state: RobotState, joint: int) -> Array:
    """Displacement (N,) of the tool, mm, by a motion of 1 rad (1 mm) of a joint."""
    by_state = point_by_state(state)[1]
    moved = np.linalg.norm(by_state[:, :, state.entry_of_joint(joint)], axis=1)
    return np.broadcast_to(moved, (len(state.poses),))


def _joints_of(modes: FormulaModes) -> tuple[int, ...]:
    """Joints, from 0, of a law's inputs."""
    out: list[int] = []
    for name in (modes.factor, modes.input):
        if (of_joint := joint_input(name)) is not None:
            out.append(of_joint[1])
        elif (summed := summed_joints(name)) is not None:
            out += [summed[0], summed[2]]
        elif (way := history_input(name)) is not None:
            out.append(way.joint)
    return tuple(dict.fromkeys(out))


# ---- what would refute it -------------------------------------------------------------------------------------------


def _refutation(
    member: SmoothJointError,
    modes: FormulaModes,
    amounts: Array,
    state: RobotState,
    training: IndexArray,
    lever_mm: float,
) -> Refutation:
    over = input_values(state, modes.input)[training]
    places = np.linspace(float(over.min()), float(over.max()), _PLACES)
    span = float(np.ptp(modes.at(places) @ amounts))
    poses: tuple[str, ...] = ()
    if modes.factor:
        by = input_values(state, modes.factor)[training]
        extremes = [int(np.argmax(by)), int(np.argmin(np.abs(by)) if _can_vanish(modes) else np.argmin(by))]
        span *= abs(float(by[extremes[0]] - by[extremes[1]])) / modes.factor_size
        poses = tuple(state.poses.ids[training[k]] for k in extremes)
    elif _is_measured_again(modes.input):
        extremes = [int(np.argmax(over)), int(np.argmin(over))]
        poses = tuple(state.poses.ids[training[k]] for k in extremes)
    return Refutation(_sweep(member, modes, state, training), poses, span, span * lever_mm)


def _can_vanish(modes: FormulaModes) -> bool:
    """Whether a factor counts from zero: a load, and no side."""
    return quantity_of(modes.factor) == "torque"


def _is_measured_again(name: str) -> bool:
    """Whether an input is no position, so that poses are to be measured again at other values of it."""
    return quantity_of(name) not in ("q",) and summed_joints(name) is None


def _sweep(member: SmoothJointError, modes: FormulaModes, state: RobotState, training: IndexArray) -> Sweep | None:
    """Sweep of the joint whose angle the law runs over; None where it runs over no turning joint's position."""
    of_joint, summed = joint_input(modes.input), summed_joints(modes.input)
    if summed is not None:
        moved = summed[0] if summed[0] != member.joint else summed[2]
    elif of_joint is not None and of_joint[0] == "q":
        moved = of_joint[1]
    else:
        return None
    if not state.robot.joints[moved].is_revolute:
        return None
    order = max((term.order for term in modes.terms if term.kind == "harmonic"), default=0)
    angles = state.poses.q[training, moved]
    return sweep_over(moved, float(angles.min()), float(angles.max()), order or 8)
