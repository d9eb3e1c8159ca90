"""Intersection of three planes (Jang 2025, eq 2), with its covariance: the corner."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, ByteArray, IndexArray
from calib.corners.quality import CornerQuality
from calib.jig import Outline


@dataclass(frozen=True)
class Face:
    """One face of the jig after refinement: the plane normal . p = offset_mm, fitted to all its inliers."""

    normal: Array  # (3,) unit, toward the scanner
    offset_mm: float
    centre_mm: Array  # (3,) weighted centroid of the inliers
    points: int
    rms_mm: float  # robust: of the inliers' heights over the plane
    inlier_bits: ByteArray  # (N / 8,) a bit for each of the scan's points: many searches are kept in memory
    group: int  # index into CornerSearch.groups
    axes: Array  # (2, 3) unit e_1, e_2 in the plane; with the normal they are perpendicular, of either hand
    # (3, 3) covariance of (h, s_1, s_2): the plane's height at centre_mm along the normal (mm) and its slopes along the
    # axes (rad; mixed terms mm rad). To first order the true normal is normal - s_1 e_1 - s_2 e_2, and the true height
    # over this plane at centre_mm + u e_1 + v e_2 is h + s_1 u + s_2 v.
    covariance: Array

    @property
    def inliers(self) -> IndexArray:
        """Indices (points,) of the inliers in the scan."""
        return np.flatnonzero(np.unpackbits(self.inlier_bits))


def packed(indices: IndexArray, count: int) -> ByteArray:
    """Bits (count / 8,) that mark the given indices among `count` points, as in `Face.inlier_bits`."""
    mask = np.zeros(count, dtype=bool)
    mask[indices] = True
    return np.packbits(mask)


@dataclass(frozen=True)
class Corner:
    """The jig's apex, the measured point, in the scanner's frame."""

    xyz_mm: Array  # (3,)
    covariance_mm2: Array  # (3, 3)
    faces: tuple[Face, Face, Face]
    plane_covariance: Array  # (9, 9) of the faces' (h, s_1, s_2) in turn; a correlated scanner error is shared by faces
    quality: CornerQuality
    outline: Outline  # of the faces in this order

    def sigma_mm(self) -> float:
        """Standard deviation of the apex over all three axes: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_mm2)))


def intersect(normals: Array, offsets_mm: Array) -> Array:
    """Point p with n_i . p = d_i (eq 2): p = N^-1 [d_1 d_2 d_3], the unit normals n_i being the rows of N.

    normals  # (..., 3, 3); offsets_mm  # (..., 3), d_i = n_i . p_i for any point p_i of the plane.
    """
    return np.asarray(np.linalg.solve(normals, offsets_mm[..., None])[..., 0], dtype=np.float64)


def intersection_covariance(normals: Array, height_covariance_mm2: Array) -> Array:
    """Covariance (3, 3) of the intersection: N^-1 H N^-T.

    H (3, 3) is the covariance of the planes' heights **at the apex**, so that the lever of a plane's tilt is included:
    to first order a plane moves the apex by its height there and by nothing else.
    """
    inverse = np.linalg.inv(normals)
    return np.asarray(inverse @ height_covariance_mm2 @ inverse.T)
