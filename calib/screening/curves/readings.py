"""Reading of learned curves: a wave of so many periods a turn, a slope, a bump, a ripple that follows the load.

A learned curve names no cause. What it looks like narrows down which part of the joint makes it, and how densely that
joint alone would have to be swept to see it by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.input_names import quantity_of, summed_joints
from calib.effects.effect import full_name
from calib.screening.curves.fitted_curves import FittedCurve, fitted_curves, learned_members, members_of_one_input
from calib.screening.curves.smooth_joint_error import (
    CouplingModes,
    CurveModes,
    FormulaModes,
    SmoothJointError,
    inputs_named,
)
from calib.statistics import rms

SLOPE, WAVE, WAVES, BUMP, LOAD, TWO_JOINTS, OTHER_INPUT, ROUGH = (
    *("slope", "wave", "waves", "bump", "load ripple", "two joints", "other input", "rough"),
)
KINDS = (SLOPE, WAVE, WAVES, BUMP, LOAD, TWO_JOINTS, OTHER_INPUT, ROUGH)
MOST_OF_IT = 0.6  # share of a curve's squares that a simple shape has to make to be its reading
MOST_WAVES = 3
_POINTS_A_WAVE = 6  # of a sweep
_STEPS_DEG = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
_MOST_POSES = 200  # of a sweep
_WIDTHS_RAD = np.radians([2.0, 4.0, 8.0, 16.0, 30.0])  # of a bump
_PLACES = 801  # at which a curve is read
_AS_GOOD = 0.02  # share that a wave of fewer periods may make less
_NEAR = 0.03  # relative difference of a wave from a multiple of the gear's ratio


@dataclass(frozen=True)
class Sweep:
    """Motion of one joint alone that shows its curve: from, to and step of its angle, the others at rest."""

    joint: int  # from 1
    start_deg: float
    end_deg: float
    step_deg: float

    @property
    def poses(self) -> int:
        """Number of poses."""
        return 1 + int(np.floor((self.end_deg - self.start_deg) / self.step_deg + 1e-9))


@dataclass(frozen=True)
class CurveReading:
    """What a learned curve looks like, in the simplest shape that makes most of it."""

    joint: int  # from 1
    input: str
    kind: str  # of KINDS
    share: float  # of the curve's squares about its mean that the shape makes
    waves_per_turn: tuple[int, ...]  # of WAVE and WAVES, the largest first; of ROUGH, the strongest
    place_deg: float | None  # of a bump
    size: float  # rms of the curve over the training poses, rad (mm for a prismatic joint)
    per_motor_turn: int | None  # multiple of the gear's ratio that a wave is, where robot.toml has it
    sweep: Sweep | None  # of the joint alone; None where the curve is not over its own angle


@lru_cache(maxsize=4)
def curve_readings(calibration: Calibration) -> tuple[CurveReading, ...]:
    """Readings of all learned curves in a fit's model, but couplings of all joints, which have no one input."""
    pairs = zip(members_of_one_input(calibration), fitted_curves(calibration), strict=True)
    return tuple(_reading(member, curve, calibration) for member, curve in pairs)


def _reading(member: SmoothJointError, curve: FittedCurve, calibration: Calibration) -> CurveReading:
    own = curve.input == f"q{curve.joint + 1}" and curve.input_unit == "deg" and not curve.factor
    if not own:
        two = summed_joints(curve.input) is not None or quantity_of(curve.input) == "q"
        kind = TWO_JOINTS if two and not curve.factor else OTHER_INPUT
        kind = LOAD if quantity_of(curve.factor or curve.input) == "torque" else kind
        return CurveReading(curve.joint + 1, inputs_named(member.modes), kind, 1.0, (), None, curve.rms, None, None)
    assert not isinstance(member.modes, CouplingModes)
    values = dict(zip((p.name for p in calibration.fit.parameters), calibration.fit.x.tolist(), strict=True))
    u = np.linspace(curve.measured[0], curve.measured[-1], _PLACES)
    value = member.modes.at(u) @ np.array([values[full_name(member, p)] for p in member.parameters])
    kind, share, orders, place = shape_of(u, value, _highest(member))
    strongest = orders[0] if orders else 8
    joint = calibration.model.robot.joints[curve.joint]
    return CurveReading(
        joint=curve.joint + 1,
        input=curve.input,
        kind=kind,
        share=share,
        waves_per_turn=orders,
        place_deg=None if place is None else float(np.degrees(place)),
        size=curve.rms,
        per_motor_turn=_per_motor_turn(strongest if kind == WAVE else 0, getattr(joint, "gear_ratio", None)),
        sweep=_sweep(curve, max(orders, default=8)),
    )


def _per_motor_turn(order: int, ratio: float | None) -> int | None:
    """Multiple (1 or 2) of the gear's ratio that a wave's number a turn is; None for none."""
    if not ratio or not order:
        return None
    return next((k for k in (1, 2) if abs(order - k * ratio) <= _NEAR * k * ratio), None)


def _sweep(curve: FittedCurve, order: int) -> Sweep:
    return sweep_over(curve.joint, float(curve.measured[0]), float(curve.measured[-1]), order)


def sweep_over(joint: int, low_rad: float, high_rad: float, order: int) -> Sweep:
    """Sweep of a joint, from 0, between two angles, dense enough to see waves of so many a turn."""
    low, high = np.degrees(low_rad), np.degrees(high_rad)
    finest = max(360.0 / (_POINTS_A_WAVE * order), (high - low) / _MOST_POSES)
    step = max((step for step in _STEPS_DEG if step <= finest), default=_STEPS_DEG[0])
    return Sweep(joint + 1, float(np.round(low, 1)), float(np.round(high, 1)), step)


def _highest(member: SmoothJointError) -> int:
    """Highest number of waves a turn that a learned curve holds."""
    if isinstance(member.modes, CurveModes):
        return int(member.modes.orders.max())
    assert isinstance(member.modes, FormulaModes)
    return max([48, *(term.order for term in member.modes.terms)])


def shape_of(u: Array, value: Array, highest: int = 48) -> tuple[str, float, tuple[int, ...], float | None]:
    """Simplest shape of a curve (G,) over angles (G,), rad: kind, share, waves a turn, and place of a bump, rad.

    A straight line, one wave, one bump, up to three waves, in this order: the first that makes `MOST_OF_IT` of the
    curve's squares about its mean, each fitted with a constant. Else it is rough, with its three strongest waves. A
    wave is told from its neighbours only over a range that is wide enough: the lowest that fits as well counts.
    """
    line = _share([u], value)
    if line > MOST_OF_IT:
        return SLOPE, line, (), None
    shares = np.array([_share([np.sin(n * u), np.cos(n * u)], value) for n in range(1, highest + 1)])
    first = int(np.argmax(shares > shares.max() - _AS_GOOD))
    bumps = [
        (_share([np.exp(-0.5 * ((u - place) / width) ** 2)], value), float(place))
        for width in _WIDTHS_RAD
        for place in np.linspace(u[0], u[-1], 41)
    ]
    bump, place = max(bumps)
    if shares[first] > MOST_OF_IT and shares[first] >= bump - 0.05:
        return WAVE, shares[first], (first + 1,), None
    if bump > MOST_OF_IT:
        return BUMP, bump, (), place
    chosen: list[int] = []
    columns: list[Array] = []
    share = 0.0
    for _ in range(MOST_WAVES):
        gains = [
            _share([*columns, np.sin(n * u), np.cos(n * u)], value) if n not in chosen else 0.0
            for n in range(1, len(shares) + 1)
        ]
        best = int(np.argmax(np.array(gains) > max(gains) - 0.5 * _AS_GOOD)) + 1
        chosen.append(best)
        columns += [np.sin(best * u), np.cos(best * u)]
        share = gains[best - 1]
        if share > MOST_OF_IT:
            return WAVES, share, tuple(chosen), None
    return ROUGH, share, tuple(chosen), None


def _share(columns: list[Array], value: Array) -> float:
    """Share of a curve's squares about its mean that some columns and a constant make."""
    centred = value - value.mean()
    total = float(centred @ centred)
    if total <= 0.0:
        return 0.0
    design = np.stack([column - column.mean() for column in columns], axis=1)
    found = np.linalg.lstsq(design, centred, rcond=1e-6)[0]
    return float(1.0 - np.sum((centred - design @ found) ** 2) / total)


# ---- couplings of all joints ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CouplingReading:
    """Error of a joint that follows the angles of the whole arm."""

    joint: int  # from 1
    size: float  # rms over the training poses, rad
    known: int  # number of parameters that the data determine to better than half their prior sigma
    parameters: int
    strongest: tuple[str, ...]  # inputs that make most of it, the first most


@lru_cache(maxsize=4)
def coupling_readings(calibration: Calibration) -> tuple[CouplingReading, ...]:
    """Readings of the couplings of all joints in a fit's model; () where there are none."""
    members = [(one, one.modes) for one in learned_members(calibration) if isinstance(one.modes, CouplingModes)]
    if not members:
        return ()
    fit, after = calibration.fit, calibration.after
    state = calibration.model.state(fit.x, calibration.dataset.poses)
    at = {p.name: i for i, p in enumerate(fit.parameters)}
    training = np.unique(after.pose[~after.is_test[after.pose]])
    out = []
    for member, modes in members:
        own = [at[full_name(member, p)] for p in member.parameters]
        moved = modes.at_state(state)[training] @ fit.x[own]
        amplitudes = np.linalg.norm((modes.weights @ fit.x[own]).reshape(-1, 2), axis=1)
        strongest = np.argsort(amplitudes)[::-1][:MOST_WAVES]
        out.append(
            CouplingReading(
                joint=member.joint + 1,
                size=rms(moved),
                known=int(np.count_nonzero(fit.sigma[own] < 0.5 * np.array(member.prior_sigma_rad))),
                parameters=len(own),
                strongest=tuple(modes.inputs[k] for k in strongest),
            )
        )
    return tuple(out)
