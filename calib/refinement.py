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
from calib.plane_fit import PlaneFit, fit_plane_robustly
from calib.waviness import plane_uncertainty

_ROUNDS = 4
_BAND_SIGMA = 12.0
_LEAST_SPREAD = 1 / 200  # standard deviation across the strip of points on a face, of the edge
SQUARENESS_DEG = 1.0
MOST_INCIDENCE_DEG = 84.0


@dataclass(frozen=True)
class RefinementOptions:
    """Which points take part."""

    edge_margin_mm: float = 0.75  # kept away from every edge of a face: rounding, blurred and flying pixels
    min_face_points: int = 12


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
    planes: list[PlaneFit] = []
    for _ in range(_ROUNDS):
        heights = local @ normals.T - offsets
        planes = []
        for face in range(3):
            on = _face_points(heights, face, bands[face], jig, options.edge_margin_mm)
            failure = _too_little(local[on], jig, options)
            if failure:
                return None, failure
            planes.append(fit_plane_robustly(local[on], near[on], normals[face], offsets[face]))
        normals = np.array([p.normal for p in planes])
        offsets = np.array([p.offset_mm for p in planes])
        bands = np.array([max(_BAND_SIGMA * p.sigma_mm, 1e-6) for p in planes])
        apex = intersect(normals, offsets)
    known = plane_uncertainty(planes, jig.edge_mm, origin / max(float(np.linalg.norm(origin)), 1e-9))
    failure = _doubt(planes, known.covariance, origin, jig)
    if failure:
        return None, failure
    covariance = intersection_covariance(normals, height_covariance(planes, known.covariance, apex))
    first, second, third = (
        _face(p, known.covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], origin, group)
        for i, (p, group) in enumerate(zip(planes, chosen, strict=True))
    )
    return Corner(origin + apex, covariance, (first, second, third), known.covariance), ""


def height_covariance(planes: Sequence[PlaneFit], covariance: NDArray, point_mm: NDArray) -> NDArray:
    """Covariance (3, 3) in mm^2 of the three planes' heights at one point (3,). covariance  # (9, 9)"""
    lever = np.zeros((3, 9))
    for i, plane in enumerate(planes):
        lever[i, 3 * i : 3 * i + 3] = plane.design(point_mm[None])[0]
    return np.asarray(lever @ covariance @ lever.T)


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


def _doubt(planes: Sequence[PlaneFit], covariance: NDArray, origin: NDArray, jig: Jig) -> str:
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
    slopes = [covariance[3 * i + 1 : 3 * i + 3, 3 * i + 1 : 3 * i + 3] for i in range(3)]
    tilt_deg = [np.degrees(np.sqrt(np.linalg.eigvalsh(slope)[-1])) for slope in slopes]
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


def _face(plane: PlaneFit, covariance: NDArray, origin: NDArray, group: int) -> Face:
    return Face(
        normal=plane.normal,
        offset_mm=float(plane.offset_mm + plane.normal @ origin),
        centre_mm=plane.centre_mm + origin,
        points=len(plane.indices),
        rms_mm=plane.sigma_mm,
        inliers=plane.indices,
        group=group,
        axes=plane.axes,
        covariance=covariance,
    )
