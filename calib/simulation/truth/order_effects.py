"""Changes during a simulated measurement: slips, knocks, a loose bolt, an arm that warms up, late readings.

Poses are measured in their order; `first` is the index of the first pose after a change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array_types import Array, BoolArray
from calib.simulation.truth.effect import needed
from calib.simulation.truth.mechanism import Arm, Conditions
from calib.simulation.truth.sampling import Rng, SampledEffect, carriers, magnitudes, one_joint
from calib.simulation.truth.visibility import SimulatedCell


def _after(count: int, first: int) -> BoolArray:
    """Mask (N,) of the first pose after a change and of all later poses."""
    return np.arange(count) >= first


def _first_pose(cell: SimulatedCell, rng: Rng) -> int:
    """Random first pose after a change, in the middle half of the measurement."""
    return int(rng.integers(len(cell.q) // 4, max(3 * len(cell.q) // 4, len(cell.q) // 4 + 1)))


@dataclass(frozen=True, eq=False)
class JointStep(SampledEffect):
    """A joint's zero jumps between two poses: dq_j = offset_j from a pose on."""

    name = "joint_step"
    magnitude_fields = ("offset_rad",)
    offset_rad: Array  # (n,)
    first: int

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        return replace(arm, q=arm.q + _after(len(arm.q), self.first)[:, None] * self.offset_rad)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        first = _first_pose(cell, rng)
        return cls(one_joint(cell, rng, lambda size: cls(size, first)), first)


@dataclass(frozen=True, eq=False)
class TargetStep(SampledEffect):
    """The target slides on the tool: a shift along the axes of the last joint's frame from a pose on."""

    name = "target_step"
    magnitude_fields = ("shift_mm",)
    needs_equilibrium = True
    shift_mm: Array  # (3,)
    first: int

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        flange = equilibrium.base_T_frame[arm.robot.n_joints]
        moved = np.where(_after(len(arm.q), self.first)[:, None], flange[:, :3, :3] @ self.shift_mm, 0.0)
        return replace(arm, target_shift_mm=arm.target_shift_mm + moved)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(0.2 * rng.standard_normal(3), _first_pose(cell, rng))


@dataclass(frozen=True, eq=False)
class ScannerStep(SampledEffect):
    """A scanner that is knocked: p becomes c + exp(w) (p - c) + v from a pose on, c the middle of its field."""

    name = "scanner_step"
    magnitude_fields = ("shift_mm", "turn_rad")
    shift_mm: Array  # (3,)
    turn_rad: Array  # (3,)
    middle_mm: Array  # (3,)
    first: int

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        knock = np.eye(4)
        knock[:3, :3] = Rotation.from_rotvec(self.turn_rad).as_matrix()
        knock[:3, 3] = self.middle_mm - knock[:3, :3] @ self.middle_mm + self.shift_mm
        after = _after(len(scanner_T_target), self.first)[:, None, None]
        return np.where(after, knock @ scanner_T_target, scanner_T_target)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Knock of the scanner whose shift and turn move a point at the field's edge about equally far."""
        middle_mm = cell.plain_mm.mean(axis=0)
        reach_mm = float(np.sqrt(np.mean(np.sum((cell.plain_mm - middle_mm) ** 2, axis=1))))
        turn_rad = 0.2 / reach_mm * rng.standard_normal(3)
        return cls(0.2 * rng.standard_normal(3), turn_rad, middle_mm, _first_pose(cell, rng))


@dataclass(frozen=True, eq=False)
class BaseLoosening(SampledEffect):
    """A bolt of the foot gives way: from a pose on the arm turns by c M about its base's origin."""

    name = "base_loosening"
    magnitude_fields = ("c_rad_per_nm",)
    needs_equilibrium = True
    c_rad_per_nm: Array  # (3,) about x, y, z of the base frame
    first: int

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        moment_nm = equilibrium.moment_nm(np.zeros((len(arm.q), 3)), 0)
        loose = _after(len(arm.q), self.first)[:, None] * self.c_rad_per_nm
        return replace(arm, base_turn_rad=arm.base_turn_rad + loose * moment_nm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(1e-6 * np.array([*rng.uniform(0.6, 1.4, 2), 0.0]), _first_pose(cell, rng))


@dataclass(frozen=True, eq=False)
class WarmUp(SampledEffect):
    """An arm warmed up by its own motors: all lengths a and d times 1 + g (1 - exp(-t / T)), t from the first pose."""

    name = "warm_up"
    needs_conditions = True
    unrecorded = ("temperature_c",)
    magnitude_fields = ("growth",)
    growth: float
    settling_s: float

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        time_s = needed(arm.conditions.time_s, "the time", self)
        warm = 1.0 - np.exp(-(time_s - time_s[0]) / self.settling_s)
        return replace(arm, growth=arm.growth * (1.0 + self.growth * warm))

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Warm-up by 10 K, with a random time constant of 10 to 40 minutes and the expansion of steel to aluminium."""
        return cls(10.0 * rng.uniform(12e-6, 24e-6), rng.uniform(600.0, 2400.0))


@dataclass(frozen=True, eq=False)
class FollowingError(SampledEffect):
    """Joints read while still moving: dq_j = k_j times the motion from the previous pose, 0 at the first."""

    name = "following_error"
    magnitude_fields = ("k",)
    k: Array  # (n,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        way = np.diff(arm.commanded, axis=0, prepend=arm.commanded[:1])
        return replace(arm, q=arm.q + self.k * way)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Following error by which every joint stops short of its target."""
        return cls(carriers(cell, rng, cls, -1e-4 * magnitudes(cell, rng)))
