"""Errors of a simulated arm's joints, axes and link lengths, each by its exact law.

Effects of loads are in `calib.simulation.truth.load_effects`, those of the scanner in
`calib.simulation.truth.scanner_effects`. The names are those of the catalogue (`calib.effects.catalogue`); the code
is independent of it, and nothing here is linearised.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.simulation.truth.effect import TrueEffect, needed
from calib.simulation.truth.mechanism import Arm

# ---- joints: dq at the commanded angle ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class TransmissionError(TrueEffect):
    """Gears that run unevenly: dq_j = sum_h cos_jh cos(h q_j) + sin_jh sin(h q_j)."""

    name = "transmission_error"
    magnitude_fields = ("cos_rad", "sin_rad")
    cos_rad: Array  # (n, H)
    sin_rad: Array  # (n, H)
    harmonics: tuple[float, ...] = (1.0, 2.0, 3.0)  # (H,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        phase = arm.commanded[:, :, None] * np.array(self.harmonics)  # (N, n, H)
        return replace(arm, q=arm.q + np.sum(self.cos_rad * np.cos(phase) + self.sin_rad * np.sin(phase), axis=2))


@dataclass(frozen=True, eq=False)
class HighHarmonic(TransmissionError):
    """Teeth of a gear, or lines of an encoder: as transmission error, 4 to 20 times a turn."""

    name = "high_harmonic"
    harmonics: tuple[float, ...] = (5.0,)


@dataclass(frozen=True, eq=False)
class FineRipple(TransmissionError):
    """A transmission error 23 times a turn, which the catalogue does not have."""

    name = "fine_ripple"
    harmonics: tuple[float, ...] = (23.0,)


@dataclass(frozen=True, eq=False)
class RoughGear(TransmissionError):
    """A joint that runs unevenly all along its range: waves that no turn brings back. Not in the catalogue."""

    name = "rough_gear"
    harmonics: tuple[float, ...] = (5.6, 7.3, 9.6, 11.4, 13.5)


@dataclass(frozen=True, eq=False)
class StrainWave(TrueEffect):
    """Ripple of a strain wave gear, once and twice a motor turn: harmonics ratio_j and 2 ratio_j of the joint."""

    name = "strain_wave"
    magnitude_fields = ("cos_rad", "sin_rad")
    cos_rad: Array  # (n, 2)
    sin_rad: Array  # (n, 2)
    gear_ratio: Array  # (n,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        phase = arm.commanded[:, :, None] * self.gear_ratio[:, None] * np.array([1.0, 2.0])
        return replace(arm, q=arm.q + np.sum(self.cos_rad * np.cos(phase) + self.sin_rad * np.sin(phase), axis=2))


@dataclass(frozen=True, eq=False)
class JointScale(TrueEffect):
    """A wrong gear ratio or encoder scale: dq_j = k_j q_j."""

    name = "joint_scale"
    magnitude_fields = ("k",)
    k: Array  # (n,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        return replace(arm, q=arm.q + self.k * arm.commanded)


@dataclass(frozen=True, eq=False)
class JointCoupling(TrueEffect):
    """One joint's motor drags another joint: dq_j = sum_i k_ji q_i."""

    name = "joint_coupling"
    magnitude_fields = ("k",)
    k: Array  # (n, n), row = the joint that is dragged

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        return replace(arm, q=arm.q + arm.commanded @ self.k.T)


@dataclass(frozen=True, eq=False)
class Backlash(TrueEffect):
    """A joint stops at the near side of its play: dq_j = b_j / 2 times the direction it came from."""

    name = "backlash"
    magnitude_fields = ("b_rad",)
    b_rad: Array  # (n,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        approach = needed(arm.conditions.approach, "the approach direction", self)
        return replace(arm, q=arm.q + 0.5 * self.b_rad * approach)


@dataclass(frozen=True, eq=False)
class JointDent(TrueEffect):
    """A damaged place in a gear: dq_j = h_j exp(-d^2 / 2 w^2), d the angle from the place."""

    name = "joint_dent"
    magnitude_fields = ("height_rad",)
    height_rad: Array  # (n,)
    place_rad: Array  # (n,)
    width_rad: float

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        off_rad = np.remainder(arm.commanded - self.place_rad + np.pi, 2.0 * np.pi) - np.pi
        bump = np.exp(-0.5 * (off_rad / self.width_rad) ** 2)
        return replace(arm, q=arm.q + self.height_rad * bump)


@dataclass(frozen=True, eq=False)
class AsymmetricScale(TrueEffect):
    """An encoder that errs alike to both sides of its zero: dq_j = k_j |q_j|."""

    name = "asymmetric_scale"
    magnitude_fields = ("k",)
    k: Array  # (n,)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        return replace(arm, q=arm.q + self.k * np.abs(arm.commanded))


@dataclass(frozen=True, eq=False)
class CableDrag(TrueEffect):
    """A cable over joints j and j + 1 pulls joint j: dq_j = a_j cos(n (q_j + s q_(j+1)) - phase), s = 1 or -1."""

    name = "cable_drag"
    magnitude_fields = ("amplitude_rad",)
    amplitude_rad: Array  # (n,) the last one 0
    phase_rad: float
    sign: float
    order: int

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        beside = np.roll(arm.commanded, -1, axis=1)  # that of the last joint is the first's, and its amplitude 0
        twisted = self.order * (arm.commanded + self.sign * beside)
        return replace(arm, q=arm.q + self.amplitude_rad * np.cos(twisted - self.phase_rad))


# ---- links and axes -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ThermalGrowth(TrueEffect):
    """Every a and d times 1 + kappa (T - reference)."""

    name = "thermal_growth"
    magnitude_fields = ("kappa_per_k",)
    kappa_per_k: float
    reference_c: float = 20.0

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        temperature_c = needed(arm.conditions.temperature_c, "a temperature", self)
        return replace(arm, growth=arm.growth * (1.0 + self.kappa_per_k * (temperature_c - self.reference_c)))


@dataclass(frozen=True, eq=False)
class AxisWobble(TrueEffect):
    """A bearing that wobbles: joint j's axis tilts at the joint's own origin, about x and y of the frame before it.

    Tilt about each = sum over h = 1, 2 of cos_h cos(h q_j) + sin_h sin(h q_j).
    """

    name = "axis_wobble"
    magnitude_fields = ("cos_rad", "sin_rad")
    cos_rad: Array  # (n, 2, 2): joint, about x or y, harmonic
    sin_rad: Array  # (n, 2, 2)

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        phase = arm.commanded[:, :, None, None] * np.array([1.0, 2.0])  # (N, n, 1, 2)
        tilt = np.sum(self.cos_rad * np.cos(phase) + self.sin_rad * np.sin(phase), axis=3)  # (N, n, 2)
        return replace(arm, axis_tilt_rad=arm.axis_tilt_rad + np.concatenate([tilt, 0.0 * tilt[:, :, :1]], 2))
