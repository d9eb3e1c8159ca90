"""The corner from all points of the three faces: robust total least squares, where the accuracy comes from.

Sample sets find the planes but throw the data away; a corner from group fits does not get better with more points.
Here every scan point of a face takes part, weighted by Tukey's biweight, and the residuals say how well the apex is
known. The outline of each face follows from the three planes, so planes and outlines are refined in turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.clustering import PlaneGroup
from calib.intersection import Corner, Face, intersect, intersection_covariance
from calib.jig import Jig

TUKEY = 4.685  # 95 % efficiency for normal residuals
_MAD_TO_SIGMA = 1.4826
_ROUNDS = 4
_REWEIGHTINGS = 12
_BAND_SIGMA = 12.0
_LEAST_SIGMA_MM = 1e-9  # of a scan without noise
_LEAST_SPREAD = 1 / 200  # standard deviation across the strip of points on a face, of the edge
_BLOCKS_AN_EDGE = 3
SQUARENESS_DEG = 1.0
MOST_INCIDENCE_DEG = 84.0


@dataclass(frozen=True)
class RefinementOptions:
    """Which points take part."""

    edge_margin_mm: float = 0.75  # kept away from every edge of a face: rounding, blurred and flying pixels
    min_face_points: int = 12


@dataclass(frozen=True)
class _Plane:
    """One face's robust fit, around the apex that the refinement started from."""

    normal: NDArray
    offset_mm: float
    centre_mm: NDArray  # (3,) weighted
    axes: NDArray  # (2, 3) two directions in the plane
    indices: NDArray  # (K,) into the scan, of the inliers: points with a weight
    points_mm: NDArray  # (K, 3)
    psi_mm: NDArray  # (K,) heights over the plane, pulled in by Tukey's weight
    sigma_mm: float  # 1.4826 MAD of the heights
    variance_mm2: float  # that one point has in the fit

    def design(self, points_mm: NDArray) -> NDArray:
        """Rows (K, 3) of a = (1, u, v): how the plane's height and its two slopes move its height at each point."""
        return np.column_stack([np.ones(len(points_mm)), (points_mm - self.centre_mm) @ self.axes.T])

    def covariance(self) -> NDArray:
        """(3, 3) of the height at the centre (mm^2) and the two slopes: s^2 (A^T A)^-1."""
        design = self.design(self.points_mm)
        return self.variance_mm2 * np.linalg.inv(design.T @ design)


def refine(
    points_mm: NDArray,
    groups: Sequence[PlaneGroup],
    chosen: tuple[int, int, int],
    jig: Jig,
    sigma_mm: float,
    options: RefinementOptions,
) -> tuple[Corner | None, str]:
    """The corner of three plane groups refined on all inliers, or None and the reason.

    points_mm  # (N, 3) the whole scan; sigma_mm is the noise along the normals, which sets the first, wide bands.
    """
    normals = np.array([groups[g].normal for g in chosen])
    start_offsets = np.array([groups[g].offset_mm for g in chosen])
    origin = intersect(normals, start_offsets)
    near = np.flatnonzero(np.sum((points_mm - origin) ** 2, axis=1) < (1.25 * jig.edge_mm) ** 2)
    local = points_mm[near] - origin  # small numbers: the planes are fitted around the first apex
    offsets = start_offsets - normals @ origin
    bands = np.full(3, max(_BAND_SIGMA * sigma_mm, 0.4))
    planes: list[_Plane] = []
    for _ in range(_ROUNDS):
        heights = local @ normals.T - offsets
        planes = []
        for face in range(3):
            on = _face_points(heights, face, bands[face], jig, options.edge_margin_mm)
            failure = _too_little(local[on], jig, options)
            if failure:
                return None, failure
            planes.append(_fit(local[on], near[on], normals[face], offsets[face]))
        normals = np.array([p.normal for p in planes])
        offsets = np.array([p.offset_mm for p in planes])
        bands = np.array([max(_BAND_SIGMA * p.sigma_mm, 1e-6) for p in planes])
        apex = intersect(normals, offsets)
    failure = _doubt(planes, origin, jig)
    if failure:
        return None, failure
    heights = np.array(
        [float((p.design(apex[None]) @ p.covariance() @ p.design(apex[None]).T)[0, 0]) for p in planes]
    )
    covariance = intersection_covariance(normals, heights) * correlation_factor(planes, jig)
    first, second, third = (_face(p, origin, group) for p, group in zip(planes, chosen, strict=True))
    return Corner(origin + apex, covariance, (first, second, third)), ""


def _face_points(heights: NDArray, face: int, band_mm: float, jig: Jig, margin_mm: float) -> NDArray:
    """Mask of the points in the band around a face's plane and inside its triangle, the margin taken off all edges.

    heights  # (K, 3) over the three planes: along an edge they fall (convex) or rise (concave) away from the apex.
    """
    along = (-heights if jig.convex else heights)[:, [i for i in range(3) if i != face]]
    inside = np.all(along > margin_mm, axis=1)
    inside &= along.sum(axis=1) < jig.edge_mm - np.sqrt(2) * margin_mm
    return inside & (np.abs(heights[:, face]) <= band_mm)


def _too_little(points: NDArray, jig: Jig, options: RefinementOptions) -> str:
    """Why a face's points (K, 3) do not define a plane, or ""."""
    if len(points) < options.min_face_points:
        return (
            f"only {len(points)} points on one of the faces, at least {options.min_face_points} are needed; "
            "turn the jig toward the scanner, or scan it finer"
        )
    centred = points - points.mean(axis=0)
    across = np.sqrt(np.linalg.eigvalsh(centred.T @ centred)[1] / len(points))
    if across < _LEAST_SPREAD * jig.edge_mm:
        return (
            f"the {len(points)} points on one of the faces lie along a line ({across:.2g} mm wide); "
            "turn the jig toward the scanner, or scan it finer"
        )
    return ""


def _fit(points: NDArray, indices: NDArray, normal: NDArray, offset: float) -> _Plane:
    """Total least squares with Tukey's weights, again and again, from the plane normal . p = offset. points  # (K, 3)

    The scale s is the MAD of the heights h over the plane before; a weight is (1 - (h / 4.685 s)^2)^2, beyond that 0.
    The variance of one point is that of an M-estimate (Huber 1981, section 7.6), over the K points with a weight:
    sum(psi^2) / (K - 3) / mean(psi')^2 with psi = w h.
    """
    heights = points @ normal - offset
    for _ in range(_REWEIGHTINGS):
        middle = np.median(heights)
        sigma = max(float(_MAD_TO_SIGMA * np.median(np.abs(heights - middle))), _LEAST_SIGMA_MM)
        weights = _tukey(heights - middle, sigma)
        centre = weights @ points / weights.sum()
        centred = points - centre
        axes = np.linalg.eigh((centred * weights[:, None]).T @ centred)[1].T  # rows, the normal first
        turned = axes[0] if axes[0] @ normal >= 0 else -axes[0]
        settled = np.linalg.norm(turned - normal) < 1e-9
        normal, heights = turned, centred @ turned
        if settled:
            break
    weights = _tukey(heights, sigma)
    inlier = weights > 0
    psi = (weights * heights)[inlier]
    root = np.sqrt(weights[inlier])
    slope = root * (5 * root - 4)  # psi' = (1 - z^2)(1 - 5 z^2), with 1 - z^2 = root
    variance = float(np.sum(psi**2) / max(len(psi) - 3, 1) / np.mean(slope) ** 2)
    offset = float(normal @ centre)
    return _Plane(normal, offset, centre, axes[1:], indices[inlier], points[inlier], psi, sigma, variance)


def _tukey(heights: NDArray, sigma_mm: float) -> NDArray:
    return np.clip(1 - (heights / (TUKEY * sigma_mm)) ** 2, 0, None) ** 2


def correlation_factor(planes: Sequence[_Plane], jig: Jig) -> float:
    """How much larger than white noise would have it the apex's covariance is, because neighbours err together.

    A scanner whose error is smooth over some millimetres fools every fit that counts points. In blocks of a third of
    the edge, white noise gives sums S_b of psi with sum(S_b^2) = s^2 (n - t), where t = tr((A^T A)^-1 sum(a_b a_b^T)),
    a_b the block's sum of design rows, is what the fit has taken out. The ratio of what is seen to that is returned
    where it exceeds 1 by more than three of its own standard deviations, otherwise 1. It is a lower bound: what is
    smooth over a whole face cannot be seen in it.
    """
    seen = expected = squares = 0.0
    for plane in planes:
        design = plane.design(plane.points_mm)
        cell = np.floor(design[:, 1:] / (jig.edge_mm / _BLOCKS_AN_EDGE)).astype(int)
        block = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
        sums = np.bincount(block, plane.psi_mm)
        rows = np.stack([np.bincount(block, column) for column in design.T], axis=1)
        taken = np.trace(np.linalg.solve(design.T @ design, rows.T @ rows))
        seen += float(sums @ sums) / (float(np.sum(plane.psi_mm**2)) / max(len(block) - 3, 1))
        expected += len(block) - taken
        squares += float(np.sum(np.bincount(block) ** 2))
    if expected <= 0:
        return 1.0
    ratio = seen / expected
    return ratio if ratio > 1 + 3 * np.sqrt(2 * squares) / expected else 1.0


def _doubt(planes: Sequence[_Plane], origin: NDArray, jig: Jig) -> str:
    """Why the three refined planes are not to be trusted, or ""."""
    for plane in planes:
        way = plane.centre_mm + origin
        incidence_deg = float(np.degrees(np.arccos(np.abs(plane.normal @ way) / np.linalg.norm(way))))
        if incidence_deg > MOST_INCIDENCE_DEG:
            return (
                f"the third face would be seen edge-on ({len(plane.indices)} points, {incidence_deg:.1f} deg off its "
                f"normal; beyond {MOST_INCIDENCE_DEG:g} deg stray points along an edge look the same); "
                "turn the jig so that three faces are seen"
            )
    tilt_deg = [np.degrees(np.sqrt(np.linalg.eigvalsh(p.covariance()[1:, 1:])[-1])) for p in planes]
    nominal_slack_deg = SQUARENESS_DEG + max(abs(a - 90) for a in jig.face_angles_deg)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        off_deg = float(np.degrees(np.arcsin(np.clip(planes[i].normal @ planes[j].normal, -1, 1))))
        slack_deg = nominal_slack_deg + 3 * np.hypot(tilt_deg[i], tilt_deg[j])
        if abs(off_deg) > slack_deg:
            return (
                f"two of the faces meet {abs(off_deg):.2f} deg out of square, more than {slack_deg:.2f} deg; "
                "look at the chosen planes, and check face_angles_deg in dataset.toml"
            )
    return ""


def _face(plane: _Plane, origin: NDArray, group: int) -> Face:
    return Face(
        normal=plane.normal,
        offset_mm=float(plane.offset_mm + plane.normal @ origin),
        centre_mm=plane.centre_mm + origin,
        points=len(plane.indices),
        rms_mm=plane.sigma_mm,
        inliers=plane.indices,
        group=group,
    )
