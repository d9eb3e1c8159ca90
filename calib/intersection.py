"""Three planes and the point where they meet (Jang 2025, eq 2), with the uncertainty of that point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Face:
    """One face of the jig after refinement: the plane normal . p = offset_mm, fitted to all its inliers."""

    normal: NDArray  # (3,) unit, toward the scanner
    offset_mm: float
    centre_mm: NDArray  # (3,) weighted centroid of the inliers
    points: int
    rms_mm: float  # robust: of the inliers' heights over the plane
    inliers: NDArray  # (points,) indices into the scan's points
    group: int  # index into CornerSearch.groups


@dataclass(frozen=True)
class Corner:
    """The jig's apex, the feature point, in the scanner's frame."""

    xyz_mm: NDArray  # (3,)
    covariance_mm2: NDArray  # (3, 3)
    faces: tuple[Face, Face, Face]

    def sigma_mm(self) -> float:
        """Standard deviation of the apex, all three axes together: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_mm2)))


def intersect(normals: NDArray, offsets_mm: NDArray) -> NDArray:
    """The point p with n_i . p = d_i (eq 2): p = N^-1 [d_1 d_2 d_3], the unit normals n_i being the rows of N.

    normals  # (..., 3, 3); offsets_mm  # (..., 3), d_i = n_i . p_i for any point p_i of the plane.
    """
    return np.linalg.solve(normals, offsets_mm[..., None])[..., 0]


def intersection_covariance(normals: NDArray, height_variances_mm2: NDArray) -> NDArray:
    """Covariance (3, 3) of the intersection: N^-1 diag(s_i^2) N^-T.

    s_i^2 is the variance of plane i's height **at the apex**, so a plane's tilt is in it with its lever: to first
    order a plane moves the apex by its height there and by nothing else.
    """
    inverse = np.linalg.inv(normals)
    return (inverse * height_variances_mm2) @ inverse.T
