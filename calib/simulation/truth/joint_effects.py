"""Errors of a simulated arm's joints, axes and link lengths, each by its exact law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.simulation.truth.mechanism import Arm, needed
from calib.simulation.truth.sampling import (
    JointError,
    Rng,
    SampledEffect,
    SimulatedCell,
    carried,
    magnitudes,
    one_joint,
)

# ---- joints: dq at the commanded angle ------------------------------------------------------------------------------


def _waves(cos_rad: Array, sin_rad: Array, phase: Array) -> Array:
    """Sum over the last axis of waves by their two parts, at phases in rad."""
    return np.asarray(np.sum(cos_rad * np.cos(phase) + sin_rad * np.sin(phase), axis=-1))


class TransmissionError(JointError):
    """Gears that run unevenly: dq_j = sum_h cos_jh cos(h q_j) + sin_jh sin(h q_j)."""

    magnitude_fields = ("cos_rad", "sin_rad")
    cos_rad: Array  # (n, H)
    sin_rad: Array  # (n, H)
    harmonics: tuple[float, ...] = (1.0, 2.0, 3.0)  # (H,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return _waves(self.cos_rad, self.sin_rad, arm.commanded[:, :, None] * np.array(self.harmonics))

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Effect with one dominant harmonic per joint: 1 (eccentric ring), 2 (oval generator) or 3 (three screws)."""
        n = cell.nominal.n_joints
        share = 0.15 + 0.85 * np.eye(3)[rng.integers(3, size=n)]
        wave = 1e-4 * share * np.exp(2j * np.pi * rng.random((n, 3)))
        return carried(
            cell, rng, lambda size: cls(size[:, None] * wave.real, size[:, None] * wave.imag), magnitudes(cell, rng)
        )


class HighHarmonic(TransmissionError):
    """Teeth of a gear, or lines of an encoder: a transmission error of 4 to 20 periods per turn."""

    harmonics: tuple[float, ...] = (5.0,)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        order, turn_rad = (float(rng.integers(4, 21)),), rng.uniform(0.0, 2.0 * np.pi)
        return one_joint(
            cell, rng, lambda size: cls(size[:, None] * np.cos(turn_rad), size[:, None] * np.sin(turn_rad), order)
        )


class FineRipple(TransmissionError):
    """A transmission error of 23 periods per turn, which is not in the catalogue."""

    in_catalogue = False
    harmonics: tuple[float, ...] = (23.0,)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Effect of one joint whose waves are equally large, with random phases."""
        phase_rad = rng.uniform(0.0, 2.0 * np.pi, len(cls.harmonics))
        cos, sin = np.cos(phase_rad), np.sin(phase_rad)
        return one_joint(cell, rng, lambda size: cls(np.outer(size, cos), np.outer(size, sin)))


class RoughGear(FineRipple):
    """A joint with an irregular error over its whole range: waves not periodic in a turn. Not in the catalogue."""

    harmonics: tuple[float, ...] = (5.6, 7.3, 9.6, 11.4, 13.5)


class StrainWave(JointError):
    """Ripple of a strain wave gear, once and twice a motor turn: harmonics ratio_j and 2 ratio_j of the joint."""

    magnitude_fields = ("cos_rad", "sin_rad")
    cos_rad: Array  # (n, 2)
    sin_rad: Array  # (n, 2)
    gear_ratio: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        motor_rad = arm.commanded * self.gear_ratio
        return _waves(self.cos_rad, self.sin_rad, motor_rad[:, :, None] * np.array([1.0, 2.0]))

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        robot = cell.nominal
        without = [
            joint.name or f"J{j + 1}"
            for j, joint in enumerate(robot.joints)
            if joint.is_revolute and joint.gear_ratio is None
        ]
        if without:
            raise CalibError(f"robot {robot.name}: no gear_ratio for {', '.join(without)}; strain_wave needs them")
        ratio = np.array([joint.gear_ratio or 1.0 for joint in robot.joints])
        share = rng.uniform(0.2, 1.0, (robot.n_joints, 2))  # once a motor turn, twice
        wave = 1e-4 * share * np.exp(2j * np.pi * rng.random(share.shape))
        return carried(
            cell,
            rng,
            lambda size: cls(size[:, None] * wave.real, size[:, None] * wave.imag, ratio),
            magnitudes(cell, rng),
        )


class JointScale(JointError):
    """A wrong gear ratio or encoder scale: dq_j = k_j q_j."""

    k: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return self.k * arm.commanded

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return carried(cell, rng, cls, 1e-4 * magnitudes(cell, rng, signed=True))


class JointCoupling(JointError):
    """One joint's motor drags another joint: dq_j = sum_i k_ji q_i."""

    k: Array  # (n, n), row = the joint that is dragged

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return arm.commanded @ self.k.T

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Coupling of the last two joints to the one before each, as wrist shafts run through the next joint."""
        n = cell.nominal.n_joints
        dragged = (np.arange(n) >= n - 2) & cell.nominal.is_revolute
        size = 1e-4 * magnitudes(cell, rng, signed=True) * dragged
        return carried(cell, rng, lambda size: cls(np.diag(size[1:], k=-1)), size)


class Backlash(JointError):
    """A joint stops at the near side of its play: dq_j = b_j / 2 times the direction it came from."""

    needs_conditions = True
    b_rad: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        approach = needed(arm.conditions.approach, "the approach direction", self)
        return 0.5 * self.b_rad * approach

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return carried(cell, rng, cls, 2e-4 * magnitudes(cell, rng))


class JointDent(JointError):
    """A damaged place in a gear: dq_j = h_j exp(-d^2 / 2 w^2), d the angle from that place."""

    height_rad: Array  # (n,)
    place_rad: Array  # (n,)
    width_rad: float

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        off_rad = np.remainder(arm.commanded - self.place_rad + np.pi, 2.0 * np.pi) - np.pi
        bump = np.exp(-0.5 * (off_rad / self.width_rad) ** 2)
        return self.height_rad * bump

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Dent with a bump of 0.2 to 0.35 rad (standard deviation), at an angle where the poses are."""
        place_rad = cell.q[rng.integers(len(cell.q))].copy()
        width_rad = rng.uniform(0.2, 0.35)

        return one_joint(cell, rng, lambda size: cls(size, place_rad, width_rad))


class AsymmetricScale(JointError):
    """A scale error of an encoder, symmetric about its zero: dq_j = k_j |q_j|."""

    k: Array  # (n,)

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        return self.k * np.abs(arm.commanded)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Effect on one joint whose poses lie on both sides of its zero."""
        share = np.mean(cell.q > 0.0, axis=0)
        both = (share > 0.15) & (share < 0.85)
        if not both.any():
            raise CalibError(f"asymmetric_scale: no joint of {cell.nominal.name} moves to both sides of its zero")
        return one_joint(cell, rng, lambda size: cls(size * both))


class CableDrag(JointError):
    """A cable over joints j and j + 1 pulls joint j: dq_j = a_j cos(n (q_j + s q_(j+1)) - phase), s = 1 or -1."""

    amplitude_rad: Array  # (n,) the last one 0
    phase_rad: float
    sign: float
    order: int

    def error(self, arm: Arm, equilibrium: Arm) -> Array:
        next_q = np.roll(arm.commanded, -1, axis=1)  # behind the last joint comes the first, with amplitude 0
        twisted = self.order * (arm.commanded + self.sign * next_q)
        return self.amplitude_rad * np.cos(twisted - self.phase_rad)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Effect with a cable over two neighbouring revolute joints."""
        phase_rad, sign = rng.uniform(0.0, 2.0 * np.pi), float(rng.choice([-1.0, 1.0]))
        order, turns = int(rng.integers(1, 3)), cell.nominal.is_revolute
        pair = np.append(turns[:-1] & turns[1:], False)
        if not pair.any():
            raise CalibError(f"cable_drag: no two neighbouring joints of {cell.nominal.name} turn")

        return one_joint(cell, rng, lambda size: cls(size * pair, phase_rad, sign, order))


# ---- links and axes -------------------------------------------------------------------------------------------------


class ThermalGrowth(SampledEffect):
    """Thermal expansion of the arm: all lengths a and d times 1 + kappa (T - reference)."""

    needs_conditions = True
    kappa_per_k: float
    reference_c: float = 20.0

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        temperature_c = needed(arm.conditions.temperature_c, "a temperature", self)
        return replace(arm, growth=arm.growth * (1.0 + self.kappa_per_k * (temperature_c - self.reference_c)))

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(rng.uniform(12e-6, 24e-6))  # steel to aluminium


class AxisWobble(SampledEffect):
    """A bearing that wobbles: joint j's axis tilts at the joint's own origin, about x and y of the frame before it.

    Tilt about each = sum over h = 1, 2 of cos_h cos(h q_j) + sin_h sin(h q_j).
    """

    magnitude_fields = ("cos_rad", "sin_rad")
    cos_rad: Array  # (n, 2, 2): joint, about x or y, harmonic
    sin_rad: Array  # (n, 2, 2)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        tilt = _waves(self.cos_rad, self.sin_rad, arm.commanded[:, :, None, None] * np.array([1.0, 2.0]))  # (N, n, 2)
        return replace(arm, axis_tilt_rad=arm.axis_tilt_rad + np.concatenate([tilt, 0.0 * tilt[:, :, :1]], 2))

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        wave = 1e-4 * rng.standard_normal((2, cell.nominal.n_joints, 2, 2))
        return carried(
            cell,
            rng,
            lambda size: cls(size[:, None, None] * wave[0], size[:, None, None] * wave[1]),
            magnitudes(cell, rng),
        )
