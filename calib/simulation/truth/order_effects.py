"""Changes during a simulated measurement: slips, knocks, a loose bolt, an arm that warms up, late readings.

Poses are measured in their order; `first` is the index of the first pose after a change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array_types import Array, BoolArray
from calib.errors import CalibError
from calib.simulation.truth.mechanism import Arm, Conditions, in_frame, needed
from calib.simulation.truth.sampling import (
    JointError,
    Rng,
    SampledEffect,
    SimulatedCell,
    carried,
    magnitudes,
    one_joint,
)
from calib.statistics import rms_length


def _after(count: int, first: int) -> BoolArray:
    """Mask (N,) of the first pose after a change and of all later poses."""
    return np.arange(count) >= first


def _first_pose(cell: SimulatedCell, rng: Rng) -> int:
    """Random first pose after a change, in the middle half of the measurement."""
    return int(rng.integers(len(cell.q) // 4, max(3 * len(cell.q) // 4, len(cell.q) // 4 + 1)))


class JointStep(JointError):
    """A joint's zero jumps between two poses: dq_j = offset_j from a pose on."""

    offset_rad: Array  # (n,)
    first: int

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return _after(len(arm.q), self.first)[:, None] * self.offset_rad

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        first = _first_pose(cell, rng)
        return one_joint(cell, rng, lambda size: cls(size, first))


class TargetStep(SampledEffect):
    """The target slides on the tool: a shift along the axes of the last joint's frame from a pose on."""

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


class ScannerStep(SampledEffect):
    """A scanner that is knocked: p becomes c + exp(w) (p - c) + v from a pose on, c the middle of its field."""

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
        reach_mm = rms_length(cell.plain_mm - middle_mm)
        turn_rad = 0.2 / reach_mm * rng.standard_normal(3)
        return cls(0.2 * rng.standard_normal(3), turn_rad, middle_mm, _first_pose(cell, rng))


class ScaleStep(SampledEffect):
    """An instrument that reports all distances from itself too long by a share from a pose on."""

    share: float
    first: int

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        out = scanner_T_target.copy()
        out[self.first :, :3, 3] *= 1.0 + self.share
        return out

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Change of the scale by 1e-4 or so."""
        return cls(float(1e-4 * rng.standard_normal()), _first_pose(cell, rng))


class BaseLoosening(SampledEffect):
    """A bolt of the foot gives way: from a pose on the arm turns by c M about its base's origin."""

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


class PayloadStep(JointError):
    """A mass hung on the flange and not recorded: dq_j = c_j tau_j, tau_j by that mass alone, from a pose on.

    It may be taken off again before the end. The controller makes up for the weights that it knows of. The mass hangs
    beside the tool point.
    """

    needs_equilibrium = True
    mass_kg: float
    c_rad_per_nm: Array  # (n,)
    beside_mm: Array  # (3,) from the tool point, tool frame
    first: int
    back: int  # first pose without it again; the number of poses where it stays

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        tool = equilibrium.base_T_frame[-1]
        place_mm = tool[:, :3, 3] + tool[:, :3, :3] @ self.beside_mm
        weight_n = self.mass_kg * np.array(arm.robot.gravity_m_s2)
        turned = np.zeros_like(arm.q)
        for j, axis in enumerate(equilibrium.base_T_axis):
            torque_nm = np.einsum("ni,ni->n", axis[:, :3, 2], np.cross(1e-3 * (place_mm - axis[:, :3, 3]), weight_n))
            turned[:, j] = self.c_rad_per_nm[j] * torque_nm
        held = _after(len(arm.q), self.first) & ~_after(len(arm.q), self.back)
        return held[:, None] * turned

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """A few kg, put on or taken off, once in three times for a while only.

        The joints yield alike, those of the wrist about four times as much.
        """
        n = cell.nominal.n_joints
        c = 1e-5 * np.where(np.arange(n) < n - 3, 1.0, 4.0) * np.exp(0.35 * rng.standard_normal(n))
        mass_kg = rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 5.0)
        first, beside_mm = _first_pose(cell, rng), rng.normal(0.0, 20.0, 3)
        back = first + len(cell.q) // 4 if rng.random() < 1.0 / 3.0 else len(cell.q)
        return cls(mass_kg, c * cell.nominal.is_revolute, beside_mm, first, back)


class LinkStep(SampledEffect):
    """A link bent by a knock: from a pose on its end is turned and shifted, both in the frame at its end."""

    magnitude_fields = ("turn_rad", "shift_mm")
    turn_rad: Array  # (n, 3)
    shift_mm: Array  # (n, 3)
    first: int

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        after = _after(len(arm.q), self.first)[:, None, None]
        return replace(
            arm,
            link_turn_rad=arm.link_turn_rad + after * self.turn_rad,
            link_shift_mm=arm.link_shift_mm + after * self.shift_mm,
        )

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """One link of 100 mm or more before the wrist's end, bent in its middle, so that its end moves too."""
        first = _first_pose(cell, rng)
        rigid = Arm.commanded_to(cell.nominal, cell.q[:1])
        ends = list(zip(rigid.base_T_axis, rigid.base_T_straight, strict=True))
        along_mm = np.stack([in_frame(end, end[:, :3, 3] - axis[:, :3, 3])[0] for axis, end in ends])
        long = np.linalg.norm(along_mm, axis=1) >= 100.0
        long[-2:] = False
        long &= np.cumsum(cell.nominal.is_revolute) > 0  # on slides alone it is a knock of the scanner
        if not long.any():
            raise CalibError(f"link_step: no link of {cell.nominal.name} is 100 mm long")
        turn_rad = 1e-3 * np.cross(rng.standard_normal(along_mm.shape), along_mm / 400.0)

        def make(size: Array) -> SampledEffect:
            turned = np.abs(size)[:, None] * long[:, None] * turn_rad
            return cls(turned, np.cross(turned, 0.5 * along_mm), first)

        return one_joint(cell, rng, make)


class WarmUp(SampledEffect):
    """An arm warmed up by its own motors: all lengths a and d times 1 + g (1 - exp(-t / T)), t from the first pose."""

    needs_conditions = True
    unrecorded = ("temperature_c",)
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


class PathFriction(JointError):
    """Friction that remembers: dq_j = h_j z_j, z_j driven in small steps along straight ways through all poses.

    dz/dq = (1 - z sign(dq)) / length, integrated by Runge and Kutta's midpoint rule.
    """

    h_rad: Array  # (n,)
    length_rad: float

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        wound = np.zeros_like(arm.q)
        for j in np.flatnonzero(self.h_rad).tolist():
            z = 0.0
            for k in range(1, len(arm.commanded)):
                way = arm.commanded[k, j] - arm.commanded[k - 1, j]
                steps = 1 + int(50.0 * abs(way) / self.length_rad)
                step, side = way / steps / self.length_rad, np.sign(way)
                for _ in range(steps):
                    middle = z + 0.5 * step * (1.0 - z * side)
                    z += step * (1.0 - middle * side)
                wound[k, j] = z
        return self.h_rad * wound

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Friction in one joint, forgotten after a way of 10 to 60 degrees."""
        length_rad = float(np.radians(np.exp(rng.uniform(np.log(10.0), np.log(60.0)))))
        return one_joint(cell, rng, lambda size: cls(size, length_rad))


class MotorHeat(SampledEffect):
    """Motors heated by their own moves: each move of w rad warms motor j by w, which cools off exponentially.

    A share of the heat goes with a fast time constant, the winding's, the rest with a slow one, the casting's. Its
    joint turns by `turn_rad` and its link's end moves out along the link by `growth` of its length, times the heat.
    """

    needs_conditions = True
    magnitude_fields = ("turn_rad", "growth")
    turn_rad: Array  # (n,)
    growth: Array  # (n,)
    cooling_s: Array  # (2,) winding, casting
    fast: float  # share of the winding

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        time_s = needed(arm.conditions.time_s, "the time", self)
        moved = np.abs(np.diff(arm.commanded, axis=0))  # (N - 1, n)
        middle_s = 0.5 * (time_s[1:] + time_s[:-1])  # a move's heat comes in the middle of its time
        since_s = time_s[:, None] - middle_s
        rates = [np.where(since_s > 0.0, np.exp(-since_s / s) / s, 0.0) @ moved for s in self.cooling_s]
        heat = self.fast * rates[0] + (1.0 - self.fast) * rates[1]
        shift_mm = arm.link_shift_mm.copy()
        rigid = Arm.commanded_to(arm.robot, arm.commanded, arm.conditions)
        for j in np.flatnonzero(self.growth).tolist():
            end = rigid.base_T_straight[j]
            shift_mm[:, j] += (self.growth[j] * heat[:, j])[:, None] * in_frame(
                end, end[:, :3, 3] - rigid.base_T_axis[j][:, :3, 3]
            )
        return replace(arm, q=arm.q + self.turn_rad * heat, link_shift_mm=shift_mm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Heat of one motor, most of it in its winding or most of it in the casting."""
        cooling_s = np.array([rng.uniform(200.0, 500.0), rng.uniform(2000.0, 4000.0)])
        fast, growth = float(rng.choice([0.15, 0.85])), rng.uniform(0.3, 1.0)

        return one_joint(cell, rng, lambda size: cls(size, growth * np.abs(size), cooling_s, fast))


class FollowingError(JointError):
    """Joints read while still moving: dq_j = k_j times the motion from the previous pose, 0 at the first."""

    k: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        way = np.diff(arm.commanded, axis=0, prepend=arm.commanded[:1])
        return self.k * way

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Following error by which every joint stops short of its target."""
        return carried(cell, rng, cls, -1e-4 * magnitudes(cell, rng))
