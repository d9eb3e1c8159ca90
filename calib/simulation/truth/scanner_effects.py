"""Errors of a simulated scanner: distortion, drift, incidence, scale, a local fault of its field.

A point is moved, the jig's orientation as seen is left alone: over the jig's 60 mm these errors hardly change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.simulation.truth.effect import TrueEffect, needed
from calib.simulation.truth.mechanism import Conditions


def _at(scanner_T_target: Array, xyz_mm: Array) -> Array:
    out = scanner_T_target.copy()
    out[:, :3, 3] = xyz_mm
    return out


@dataclass(frozen=True, eq=False)
class ScannerDistortion(TrueEffect):
    """About the middle of the field: depth z + k1 z + k2 z^2, and x, y times 1 + k r^2."""

    name = "scanner_distortion"
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


@dataclass(frozen=True, eq=False)
class ScannerDrift(TrueEffect):
    """The scanner's stand creeps: p becomes exp(w t) p + v t, t from the first pose."""

    name = "scanner_drift"
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
        return np.asarray(move @ scanner_T_target)


@dataclass(frozen=True, eq=False)
class IncidenceBias(TrueEffect):
    """A range that grows with the angle phi between the jig's axis and the ray: b (1 - cos phi) along the ray."""

    name = "incidence_bias"
    magnitude_fields = ("b_mm",)
    b_mm: float

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        xyz_mm = scanner_T_target[:, :3, 3]
        ray = xyz_mm / np.linalg.norm(xyz_mm, axis=1, keepdims=True)
        cos_phi = -np.sum(sign * scanner_T_target[:, :3, 2] * ray, axis=1, keepdims=True)
        return _at(scanner_T_target, xyz_mm + self.b_mm * (1.0 - cos_phi) * ray)


@dataclass(frozen=True, eq=False)
class ScannerScale(TrueEffect):
    """Every length 1 + s times too long."""

    name = "scanner_scale"
    magnitude_fields = ("s",)
    s: float

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        return _at(scanner_T_target, (1.0 + self.s) * scanner_T_target[:, :3, 3])


@dataclass(frozen=True, eq=False)
class FieldBump(TrueEffect):
    """A local fault of the field: a shift times exp(-d^2 / 2 w^2), d from its place. Not in the catalogue."""

    name = "field_bump"
    magnitude_fields = ("shift_mm",)
    shift_mm: Array  # (3,)
    place_mm: Array  # (3,) scanner frame
    width_mm: float

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        xyz_mm = scanner_T_target[:, :3, 3]
        off = np.sum((xyz_mm - self.place_mm) ** 2, axis=1, keepdims=True) / self.width_mm**2
        return _at(scanner_T_target, xyz_mm + np.exp(-0.5 * off) * self.shift_mm)
