"""Draw the effects that are of one place or one pose, or of few joints; magnitudes are set afterwards."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.carriers import Rng, carriers, magnitudes, one_joint
from calib.simulation.truth.effect import TrueEffect
from calib.simulation.truth.joint_effects import AsymmetricScale, CableDrag, HighHarmonic, JointDent
from calib.simulation.truth.load_effects import BearingClearance, LinkTorsion, NonlinearStiffness
from calib.simulation.truth.order_effects import (
    BaseLoosening,
    FollowingError,
    JointStep,
    ScannerStep,
    TargetStep,
    WarmUp,
)
from calib.simulation.truth.visibility import SimulatedCell, gravity_torques


def _first(cell: SimulatedCell, rng: Rng) -> int:
    """Somewhere in the middle half of the measurement."""
    return int(rng.integers(len(cell.q) // 4, max(3 * len(cell.q) // 4, len(cell.q) // 4 + 1)))


def _joint_step(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    first = _first(cell, rng)
    return JointStep(one_joint(cell, rng, lambda size: JointStep(size, first)), first)


def _joint_dent(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """A bump of 0.2 to 0.35 rad (standard deviation), at an angle where the poses are."""
    place_rad = cell.q[rng.integers(len(cell.q))].copy()
    width_rad = rng.uniform(0.2, 0.35)

    def make(size: Array) -> TrueEffect:
        return JointDent(size, place_rad, width_rad)

    return make(one_joint(cell, rng, make))


def _target_step(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return TargetStep(0.2 * rng.standard_normal(3), _first(cell, rng))


def _scanner_step(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Shift and turn move a point at the field's edge alike."""
    middle_mm = cell.plain_mm.mean(axis=0)
    reach_mm = float(np.sqrt(np.mean(np.sum((cell.plain_mm - middle_mm) ** 2, axis=1))))
    turn_rad = 0.2 / reach_mm * rng.standard_normal(3)
    return ScannerStep(0.2 * rng.standard_normal(3), turn_rad, middle_mm, _first(cell, rng))


def _base_loosening(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    return BaseLoosening(1e-6 * np.array([*rng.uniform(0.6, 1.4, 2), 0.0]), _first(cell, rng))


def _warm_up(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Motors heat an arm within half an hour or two; steel to aluminium, 10 K."""
    return WarmUp(10.0 * rng.uniform(12e-6, 24e-6), rng.uniform(600.0, 2400.0))


def _following_error(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Every joint stops short."""
    return FollowingError(carriers(cell, rng, FollowingError, -1e-4 * magnitudes(cell, rng)))


def _asymmetric_scale(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """One joint whose poses lie on both sides of its zero."""
    share = np.mean(cell.q > 0.0, axis=0)
    both = (share > 0.15) & (share < 0.85)
    if not both.any():
        raise CalibError(f"asymmetric_scale: no joint of {cell.nominal.name} moves to both sides of its zero")
    return AsymmetricScale(one_joint(cell, rng, lambda size: AsymmetricScale(size * both)))


def _high_harmonic(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    order, turn_rad = (float(rng.integers(4, 21)),), rng.uniform(0.0, 2.0 * np.pi)

    def make(size: Array) -> TrueEffect:
        return HighHarmonic(size[:, None] * np.cos(turn_rad), size[:, None] * np.sin(turn_rad), order)

    return make(one_joint(cell, rng, make))


def _cable_drag(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Over two neighbouring joints that turn."""
    phase_rad, sign = rng.uniform(0.0, 2.0 * np.pi), float(rng.choice([-1.0, 1.0]))
    order, turns = int(rng.integers(1, 3)), cell.nominal.is_revolute
    pair = np.append(turns[:-1] & turns[1:], False)
    if not pair.any():
        raise CalibError(f"cable_drag: no two neighbouring joints of {cell.nominal.name} turn")

    def make(size: Array) -> TrueEffect:
        return CableDrag(size * pair, phase_rad, sign, order)

    return make(one_joint(cell, rng, make))


def _nonlinear_stiffness(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """Softest where the torque is small: each joint yields alike at its largest torque."""
    largest = np.abs(gravity_torques(cell)).max(axis=0)
    size = np.where(largest > 0.3, 1e-4 / np.maximum(largest, 0.3) ** 2, 0.0) * magnitudes(cell, rng)
    return NonlinearStiffness(carriers(cell, rng, NonlinearStiffness, size))


def _link_torsion(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """One link; where it lies along its joint's axis torsion is that joint's compliance, so these stay stiff."""
    rows = cell.nominal.table[:-1]
    long = np.abs(rows[:, 0]) > np.maximum(50.0, 0.1 * np.abs(rows[:, 2]))
    if not long.any():
        raise CalibError(f"link_torsion: no link of {cell.nominal.name} reaches out from its joint's axis")

    def make(size: Array) -> TrueEffect:
        return LinkTorsion(np.abs(size) * long)

    return make(one_joint(cell, rng, make))


def _bearing_clearance(cell: SimulatedCell, rng: Rng) -> TrueEffect:
    """The axis of one joint."""
    return BearingClearance(np.abs(one_joint(cell, rng, lambda size: BearingClearance(np.abs(size)))))


FURTHER: dict[str, Callable[[SimulatedCell, Rng], TrueEffect]] = {
    "joint_step": _joint_step,
    "joint_dent": _joint_dent,
    "target_step": _target_step,
    "scanner_step": _scanner_step,
    "base_loosening": _base_loosening,
    "warm_up": _warm_up,
    "following_error": _following_error,
    "asymmetric_scale": _asymmetric_scale,
    "high_harmonic": _high_harmonic,
    "cable_drag": _cable_drag,
    "nonlinear_stiffness": _nonlinear_stiffness,
    "link_torsion": _link_torsion,
    "bearing_clearance": _bearing_clearance,
}
