"""What is known of a scanner's smooth error beforehand, where a scan does not show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.planes.robust_fit import PlaneFit


@dataclass(frozen=True)
class ToldNoise:
    """What `[scanner]` of dataset.toml tells; 0: nothing."""

    correlated_sigma_mm: float = 0.0  # of the error that neighbouring points share, along the ray
    correlation_length_mm: float = 0.0  # l of its correlation exp(-r^2 / 2 l^2)
    registration_sigma_mm: float = 0.0  # by which surfaces that were joined of several views are off, each axis


NOTHING_TOLD = ToldNoise()
MESH_NOTE = (
    "neighbouring points share their errors, as in a mesh or where views were joined; how well those were joined no "
    "scan shows: give registration_sigma_mm or, of one view, correlated_sigma_mm under [scanner] in dataset.toml"
)


def apex_variance_mm2(planes: Sequence[PlaneFit], covariance: Array) -> Array:
    """Trace (...) of the covariance of the point where three planes meet. covariance  # (..., 9, 9) of the planes"""
    normals = np.array([plane.normal for plane in planes])
    apex = np.linalg.solve(normals, np.array([plane.offset_mm for plane in planes]))
    lever = np.zeros((3, 9))
    for face, plane in enumerate(planes):
        lever[face, 3 * face : 3 * face + 3] = plane.design(apex[None])[0]
    moved = np.linalg.solve(normals, lever)
    return np.einsum("jk,...jk->...", moved.T @ moved, covariance)


def no_less_than_told(planes: Sequence[PlaneFit], shown: Array, told: Array) -> Array:
    """The covariance (9, 9) of a smooth error that the scan shows, made up to what is told, as the apex feels both."""
    told_mm2 = float(apex_variance_mm2(planes, told))
    if told_mm2 <= 0:
        return shown
    return np.asarray(shown + max(0.0, 1 - float(apex_variance_mm2(planes, shown) / told_mm2)) * told)


def registration_covariance(planes: Sequence[PlaneFit], sigma_mm: float) -> Array:
    """(9, 9) of three planes that are shifted together by an error of sigma_mm in each axis; no scan shows it."""
    normals = np.array([plane.normal for plane in planes])
    covariance = np.zeros((9, 9))
    covariance[::3, ::3] = sigma_mm**2 * normals @ normals.T
    return covariance
