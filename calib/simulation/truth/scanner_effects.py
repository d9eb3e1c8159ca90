"""Errors of a simulated scanner: distortion, drift, incidence, scale, a local fault of its field.

A point is moved, the jig's orientation as seen is left alone: over the jig's 60 mm these errors hardly change.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.simulation.truth.mechanism import Conditions, needed
from calib.simulation.truth.sampling import Rng, SampledEffect, SimulatedCell
from calib.statistics import rms_length


def _at(scanner_T_target: Array, xyz_mm: Array) -> Array:
    """Frames (N, 4, 4) moved to other positions (N, 3), their orientations kept."""
    moved = scanner_T_target.copy()
    moved[:, :3, 3] = xyz_mm
    return moved


class ScannerDistortion(SampledEffect):
    """Distortion about the middle of the field: depth z + k1 z + k2 z^2, and x, y times 1 + k r^2."""

    magnitude_fields = ("k1", "k2_per_mm", "k_per_mm2")
    k1: float
    k2_per_mm: float
    k_per_mm2: float
    middle_mm: Array  # (3,) scanner frame

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        xyz_mm = scanner_T_target[:, :3, 3]
        x, y, z = (xyz_mm - self.middle_mm).T
        radial = self.k_per_mm2 * (x**2 + y**2)
        shift_mm = np.column_stack([radial * x, radial * y, self.k1 * z + self.k2_per_mm * z**2])
        return _at(scanner_T_target, xyz_mm + shift_mm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Distortion of three terms, one dominant; each could move a point at the field's edge equally far."""
        middle_mm = cell.plain_mm.mean(axis=0)
        reach_mm = rms_length(cell.plain_mm - middle_mm)
        k = 0.2 * rng.choice([-1.0, 1.0], 3) * (0.2 + 0.8 * np.eye(3)[rng.integers(3)])
        return cls(k[0] / reach_mm, k[1] / reach_mm**2, k[2] / reach_mm**3, middle_mm)


class ScannerDrift(SampledEffect):
    """A scanner that creeps: a point p becomes exp(w t) p + v t, t from the first pose."""

    needs_conditions = True
    magnitude_fields = ("v_mm_per_s", "w_rad_per_s")
    v_mm_per_s: Array  # (3,)
    w_rad_per_s: Array  # (3,)

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        if self.is_absent:
            return scanner_T_target
        time_s = needed(conditions.time_s, "the time", self)
        t = (time_s - time_s[0])[:, None]
        move = np.tile(np.eye(4), (len(t), 1, 1))
        move[:, :3, :3] = Rotation.from_rotvec(t * self.w_rad_per_s).as_matrix()
        move[:, :3, 3] = t * self.v_mm_per_s
        return move @ scanner_T_target

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(1e-4 * rng.standard_normal(3), 1e-7 * rng.standard_normal(3))


class IncidenceBias(SampledEffect):
    """Range error that grows with the angle phi between the jig's axis and the ray: b (1 - cos phi) along the ray."""

    needs_facing_jig = True  # the incidence of a jig that faces away is undefined
    b_mm: float

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        xyz_mm = scanner_T_target[:, :3, 3]
        ray = xyz_mm / np.linalg.norm(xyz_mm, axis=1, keepdims=True)
        cos_phi = -np.sum(sign * scanner_T_target[:, :3, 2] * ray, axis=1, keepdims=True)
        return _at(scanner_T_target, xyz_mm + self.b_mm * (1.0 - cos_phi) * ray)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(0.2 * float(rng.choice([-1.0, 1.0])))


class ScannerScale(SampledEffect):
    """A scale error of the scanner: every length 1 + s times too long."""

    s: float

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        return _at(scanner_T_target, (1.0 + self.s) * scanner_T_target[:, :3, 3])

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        return cls(2e-4 * float(rng.choice([-1.0, 1.0])))


class FieldBump(SampledEffect):
    """Local fault of the scanner: a shift times exp(-d^2 / 2 w^2) at distance d from a place. Not in the catalogue."""

    in_catalogue = False
    shift_mm: Array  # (3,)
    place_mm: Array  # (3,) scanner frame
    width_mm: float

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        xyz_mm = scanner_T_target[:, :3, 3]
        off = np.sum((xyz_mm - self.place_mm) ** 2, axis=1, keepdims=True) / self.width_mm**2
        return _at(scanner_T_target, xyz_mm + np.exp(-0.5 * off) * self.shift_mm)

    @classmethod
    def draw(cls, cell: SimulatedCell, rng: Rng) -> SampledEffect:
        """Bump at one of the points, 0.25 to 0.4 times as wide (standard deviation) as the points' RMS radius."""
        middle_mm = cell.plain_mm.mean(axis=0)
        reach_mm = rms_length(cell.plain_mm - middle_mm)
        direction = rng.standard_normal(3) * np.array([0.3, 0.3, 1.0])
        place_mm = cell.plain_mm[rng.integers(len(cell.q))]
        return cls(0.3 * direction / np.linalg.norm(direction), place_mm, reach_mm * rng.uniform(0.25, 0.4))
