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


@dataclass(frozen=True)
class RefinementOptions:
    """Which points take part."""

    edge_margin_mm: float = 0.75  # kept away from every edge of a face: rounding, blurred and flying pixels
    min_face_points: int = 12


@dataclass(frozen=True)
class _Plane:
    """A weighted plane fit; points, residuals and weights belong together."""

    normal: NDArray
    centre_mm: NDArray
    indices: NDArray  # (K,) into the scan
    points_mm: NDArray  # (K, 3)
    heights_mm: NDArray  # (K,)
    weights: NDArray  # (K,)
    sigma_mm: float


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
    apex = intersect(normals, start_offsets)
    near = np.flatnonzero(np.sum((points_mm - apex) ** 2, axis=1) < (1.25 * jig.edge_mm) ** 2)
    local = points_mm[near] - apex  # small numbers: the planes are fitted around the apex
    offsets = start_offsets - normals @ apex
    bands = np.full(3, max(_BAND_SIGMA * sigma_mm, 0.4))
    planes: list[_Plane] = []
    for _ in range(_ROUNDS):
        heights = local @ normals.T - offsets
        planes = []
        for face in range(3):
            on = _face_points(heights, face, bands[face], jig, options.edge_margin_mm)
            if np.count_nonzero(on) < options.min_face_points:
                return None, (
                    f"only {np.count_nonzero(on)} points on face {face + 1} of the corner "
                    f"(at least {options.min_face_points} are needed); turn the jig toward the scanner or scan it finer"
                )
            planes.append(_fit(local[on], near[on], normals[face], offsets[face]))
        normals = np.array([p.normal for p in planes])
        offsets = np.array([p.normal @ p.centre_mm for p in planes])
        bands = np.array([max(_BAND_SIGMA * p.sigma_mm, 1e-6) for p in planes])
    variances = np.array([_height_variance(p, intersect(normals, offsets)) for p in planes])
    first, second, third = (_face(p, apex, group) for p, group in zip(planes, chosen, strict=True))
    xyz = apex + intersect(normals, offsets)
    return Corner(xyz, intersection_covariance(normals, variances), (first, second, third)), ""


def _face_points(heights: NDArray, face: int, band_mm: float, jig: Jig, margin_mm: float) -> NDArray:
    """Mask of the points in the band around a face's plane and inside its triangle, the margin taken off all edges.

    heights  # (K, 3) over the three planes: along an edge they fall (convex) or rise (concave) away from the apex.
    """
    along = (-heights if jig.convex else heights)[:, [i for i in range(3) if i != face]]
    inside = np.all(along > margin_mm, axis=1)
    inside &= along.sum(axis=1) < jig.edge_mm - np.sqrt(2) * margin_mm
    return inside & (np.abs(heights[:, face]) <= band_mm)


def _fit(points: NDArray, indices: NDArray, normal: NDArray, offset: float) -> _Plane:
    """Total least squares with Tukey's weights, again and again, from the plane normal . p = offset. points  # (K, 3)

    The scale is the MAD of the heights, from the start plane first; a weight is (1 - (h / 4.685 s)^2)^2, 0 outside.
    """
    heights = points @ normal - offset
    weights = np.ones(len(points))
    centre, sigma = points.mean(axis=0), 0.0
    for _ in range(_REWEIGHTINGS):
        middle = np.median(heights)
        sigma = float(_MAD_TO_SIGMA * np.median(np.abs(heights - middle)))
        cut = TUKEY * max(sigma, 1e-9)
        weights = np.clip(1 - ((heights - middle) / cut) ** 2, 0, None) ** 2
        centre = weights @ points / weights.sum()
        centred = points - centre
        turned = np.linalg.eigh((centred * weights[:, None]).T @ centred)[1][:, 0]
        turned = turned if turned @ normal >= 0 else -turned
        before, normal = normal, turned
        heights = centred @ normal
        if np.linalg.norm(before - normal) < 1e-9:
            break
    return _Plane(normal, centre, indices, points, heights, weights, sigma)


def _height_variance(plane: _Plane, at: NDArray) -> float:
    """Variance of the plane's height at the point `at`: a (A^T A)^-1 a^T s^2, a = (1, u, v) in the plane's axes.

    s^2 = sum(psi^2) / (sum psi'/K)^2 / (K - 3) is the variance that Tukey's estimate has per point; Huber 1981, 7.6.
    """
    scale = max(plane.sigma_mm, 1e-9)
    z2 = np.clip((plane.heights_mm / (TUKEY * scale)) ** 2, 0, 1)
    psi = plane.heights_mm * (1 - z2) ** 2
    slope = np.where(z2 < 1, (1 - z2) * (1 - 5 * z2), 0)
    count = len(psi)
    per_point = np.sum(psi**2) / (count - 3) / np.mean(slope) ** 2
    axes = np.linalg.svd(plane.normal[None])[2][1:]  # two directions in the plane
    inliers = plane.points_mm[z2 < 1]
    design = np.c_[np.ones(len(inliers)), (inliers - plane.centre_mm) @ axes.T]
    here = np.r_[1.0, (at - plane.centre_mm) @ axes.T]
    # (A^T A)^-1 is that of all `count` points; the rejected ones have no place in it, so scale theirs up.
    return float(per_point * here @ np.linalg.solve(design.T @ design, here) * len(inliers) / count)


def _face(plane: _Plane, origin: NDArray, group: int) -> Face:
    inlier = plane.weights > 0
    return Face(
        normal=plane.normal,
        offset_mm=float(plane.normal @ (plane.centre_mm + origin)),
        centre_mm=plane.centre_mm + origin,
        points=int(np.count_nonzero(inlier)),
        rms_mm=plane.sigma_mm,
        inliers=plane.indices[inlier],
        group=group,
    )
