"""Intersection of three planes (Jang 2025, eq 2), with its covariance: the corner."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, ByteArray, IndexArray
from calib.brief import Brief
from calib.corners.correlated_noise.bow import BowEvidence
from calib.corners.faces.angles import turned_normals
from calib.corners.quality import CornerQuality
from calib.errors import CornerError
from calib.jig import Outline
from calib.planes.robust_fit import height_lever

_LEAST_VOLUME = 1e-6  # of three unit normals: 1 at right angles, 0 where two planes are parallel


@dataclass(frozen=True)
class Face(Brief):
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
class Corner(Brief):
    """The jig's apex, the measured point, in the scanner's frame."""

    xyz_mm: Array  # (3,)
    covariance_mm2: Array  # (3, 3)
    faces: tuple[Face, Face, Face]
    plane_covariance: Array  # (9, 9) of the faces' (h, s_1, s_2) in turn; a correlated scanner error is shared by faces
    quality: CornerQuality
    outline: Outline  # of the faces in this order
    free: Corner | None = None  # the same with its three planes fitted freely, where angles are held between them
    bows: BowEvidence | None = None  # what the scan tells of bows of the faces
    flat: Corner | None = None  # the same with its faces taken as flat, where all scans tell their bows

    @property
    def without_held_angles(self) -> Corner:
        """This corner with its three planes fitted freely."""
        return self.free or self

    @property
    def as_fitted(self) -> Corner:
        """This corner as its own scan tells it: no angles held, faces taken as flat."""
        return self.without_held_angles.flat or self.without_held_angles

    def sigma_mm(self) -> float:
        """Standard deviation of the apex over all three axes: sqrt(trace of the covariance)."""
        return float(np.sqrt(np.trace(self.covariance_mm2)))

    def _brief(self) -> str:
        x, y, z = self.xyz_mm
        return f"({x:.4f}, {y:.4f}, {z:.4f}) mm, sigma {self.sigma_mm():.4f} mm"


@dataclass(frozen=True)
class Intersection(Brief):
    """The point where three planes meet, in the frame of the planes."""

    xyz_mm: Array  # (3,)
    covariance_mm2: Array | None  # (3, 3); None where the planes' uncertainty was not given

    @property
    def sigma_mm(self) -> float | None:
        """Standard deviation of the point, all three axes together: sqrt(trace of the covariance)."""
        return None if self.covariance_mm2 is None else float(np.sqrt(np.trace(self.covariance_mm2)))

    def _brief(self) -> str:
        x, y, z = self.xyz_mm
        sigma = "" if self.sigma_mm is None else f", sigma {self.sigma_mm:.4f} mm"
        return f"({x:.4f}, {y:.4f}, {z:.4f}) mm{sigma}"


def intersect_planes(
    normals: ArrayLike, offsets_mm: ArrayLike, height_covariance_mm2: ArrayLike | None = None
) -> Intersection:
    """The point where three planes normal . p = offset meet (Jang 2025, eq 2), with its covariance N^-1 H N^-T.

    Args:
        normals: (3, 3) a normal in each row, of any length; the offsets are of the unit normals.
        offsets_mm: (3,) distance of each plane from the origin along its unit normal.
        height_covariance_mm2: (3, 3) covariance H of the planes' heights at the corner, or (3,) variances of
            independent planes; a plane's tilt belongs in it, times the distance of the corner from its points.

    Raises:
        CornerError: shapes that do not fit, a normal of length 0, or planes that meet in no single point.

    >>> import calib
    >>> calib.intersect_planes([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [10.0, 20.0, 30.0], [0.01**2] * 3)
    Intersection((10.0000, 20.0000, 30.0000) mm, sigma 0.0173 mm)
    """
    rows, offsets = np.asarray(normals, dtype=float), np.asarray(offsets_mm, dtype=float)
    if rows.shape != (3, 3) or offsets.shape != (3,):
        raise CornerError(f"found normals {rows.shape} and offsets {offsets.shape}; three planes have (3, 3) and (3,)")
    length = np.linalg.norm(rows, axis=1)
    if not (np.isfinite(rows).all() and np.isfinite(offsets).all() and length.all()):
        raise CornerError("found a normal of length 0 or a number that is not finite; give three planes")
    rows = rows / length[:, None]
    volume = abs(float(np.linalg.det(rows)))
    if volume < _LEAST_VOLUME:
        raise CornerError(
            f"the planes meet in no single point: their unit normals span a volume of {volume:.2g}; two are parallel, "
            "or all three to one line"
        )
    covariance = None
    if height_covariance_mm2 is not None:
        heights = np.asarray(height_covariance_mm2, dtype=float)
        heights = np.diag(heights) if heights.shape == (3,) else heights
        if heights.shape != (3, 3):
            raise CornerError(f"found a covariance of shape {heights.shape}; give (3, 3), or (3,) variances")
        covariance = intersection_covariance(rows, heights)
    return Intersection(intersect(rows, offsets), covariance)


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
    return inverse @ height_covariance_mm2 @ inverse.T


def moved_corner(corner: Corner, moves: Array, covariance: Array) -> Corner:
    """Corner whose planes are moved by heights, mm, and slopes, rad (9,), and then have the covariance (9, 9)."""
    normals = turned_normals(corner.faces, moves)
    offsets = np.array([n @ f.centre_mm + h for n, f, h in zip(normals, corner.faces, moves[::3], strict=True)])
    apex = intersect(normals, offsets)
    one, two, three = (
        replace(
            face,
            normal=normal,
            offset_mm=float(offset),
            centre_mm=face.centre_mm + height * normal,
            axes=face.axes - np.outer(face.axes @ normal, normal),
            covariance=covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3],
        )
        for i, (face, normal, offset, height) in enumerate(zip(corner.faces, normals, offsets, moves[::3], strict=True))
    )
    lever = height_lever((one, two, three), apex)
    apex_mm2 = intersection_covariance(normals, lever @ covariance @ lever.T)
    sharper = float(np.sqrt(np.trace(apex_mm2) / np.trace(corner.covariance_mm2)))
    quality = replace(corner.quality, amplification=sharper * corner.quality.amplification)
    return Corner(apex, apex_mm2, (one, two, three), covariance, quality, corner.outline)
