"""Refinement of the corner on all points of the three faces by robust total least squares.

Sample sets find the planes but use few of the points; a corner from their groups does not get better with more points.
Here every scan point of a face takes part, weighted by Tukey's biweight, and the apex's covariance follows from the
residuals. The outline of each face follows from the three planes, so planes and outlines are refined in turns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, IndexArray
from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.corners.correlated_noise.plane_uncertainty import plane_uncertainty
from calib.corners.correlated_noise.surroundings import flat_surroundings
from calib.corners.faces.face_outline import along_edges, face_points, flat_margins_mm, without_far_points
from calib.corners.faces.mixed_pixels import refit_narrow_faces
from calib.corners.intersection import Corner, Face, intersect, intersection_covariance, packed
from calib.corners.jig_angles import with_common_angles
from calib.corners.quality_figures import height_covariance, quality_figures
from calib.corners.refusals import RefinedFaces, require_faces
from calib.errors import CornerError
from calib.jig import Jig, Outline
from calib.planes.clustering import PlaneGroup
from calib.planes.point_selection import points_within
from calib.planes.robust_fit import PlaneFit, fit_plane_robustly

_ROUNDS = 6
_LAST_ROUNDS = 2
_AT_REST = 0.3  # sigmas that a plane moves at the face's ends in a round: after it the last rounds follow
_POINTS_AT_FIRST = 20_000
_POINTS_FOR_SPREAD = 3_000
_BAND_SIGMA = 12.0
_LESS_MARGIN = (1.0, 0.5, 0.2)
_MARGIN_SIGMA = 3.0  # a face's own noise must not carry its points over the edge into the other face's band
_FEWEST_POINTS = 6  # of a face
_LEAST_SPREAD = 1 / 200  # standard deviation across the strip of points on a face, of the edge


def refine(
    points_mm: Array,
    groups: Sequence[PlaneGroup],
    chosen: tuple[int, int, int],
    jig: Jig,
    outline: Outline,
    sigma_mm: float,
    declared: DeclaredNoise = NOTHING_DECLARED,
    scan_sigma_mm: float | None = None,
) -> Corner:
    """Corner of three plane groups, refined on all inliers.

    points_mm  # (N, 3) the whole scan; sigma_mm is the noise along the normals, which sets the first, wide bands;
    declared is the scanner's correlated error; scan_sigma_mm is its declared noise, for the quality figures only;
    outline is that of the faces, in the order of the chosen groups.

    Raises CornerError with the reason where the points do not define three planes that meet like the jig's faces.
    """
    normals = np.array([groups[g].normal for g in chosen])
    start_offsets = np.array([groups[g].offset_mm for g in chosen])
    origin = intersect(normals, start_offsets)
    _, middle_mm, longest_mm = sorted(jig.edges_mm)
    reach_mm = 1.1 * (np.hypot(middle_mm, longest_mm) if outline.rectangular else longest_mm)
    # From the first apex, so that the planes are fitted in small numbers.
    near, local = points_within(points_mm, origin, reach_mm)
    planes, margins_mm = _fit_faces(local, near, normals, start_offsets - normals @ origin, jig, outline, sigma_mm)

    def fit(points: Array, heights: Array, indices: IndexArray, face: int, margin_mm: float) -> PlaneFit:
        plane, band_mm = planes[face], _BAND_SIGMA * planes[face].sigma_mm
        on = _points_of_face(points, heights, face, band_mm, margin_mm, jig, outline)
        return fit_plane_robustly(points[on], indices[on], plane.normal, plane.offset_mm)

    planes, margins_mm = refit_narrow_faces(local, near, planes, margins_mm, origin, jig, outline, fit)
    margin_mm = float(margins_mm.max())
    surroundings = flat_surroundings(
        points_mm, groups, chosen, origin, jig.shortest_mm, max(plane.sigma_mm for plane in planes)
    )
    known = plane_uncertainty(planes, jig, origin, surroundings, declared, rectangular=outline.rectangular)
    planes = list(known.planes)
    require_faces(RefinedFaces(planes, known.covariance, local, origin, jig, outline))
    covariance = known.covariance
    normals = np.array([plane.normal for plane in planes])
    apex = intersect(normals, np.array([plane.offset_mm for plane in planes]))
    one, two, three = (
        _face(plane, origin, group, covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], len(points_mm))
        for i, (plane, group) in enumerate(zip(planes, chosen, strict=True))
    )
    declared_mm = declared.correlated_sigma_mm
    corner = Corner(
        origin + apex,
        intersection_covariance(normals, height_covariance(planes, covariance, apex)),
        (one, two, three),
        covariance,
        quality_figures(planes, known, origin, apex, jig, outline, margin_mm,
                        scan_sigma_mm and float(np.hypot(scan_sigma_mm, declared_mm)), declared_mm),
        outline,
        bows=known.bows,
    )  # fmt: skip
    return with_common_angles({"": corner}, jig)[0][""]


def _fit_faces(
    local: Array,
    near: IndexArray,
    normals: Array,
    offsets: Array,
    jig: Jig,
    outline: Outline,
    sigma_mm: float,
) -> tuple[list[PlaneFit], Array]:
    """Robustly fitted planes of the three faces, and the margins (3,), mm, along the edges whose points are left out.

    The faces' outlines and the planes are refined in turns.

    Raises CornerError where a face has too few points, or points along a line.
    """
    bands = np.full(3, _BAND_SIGMA * max(sigma_mm, jig.shortest_mm / 1800))
    margins_mm = np.full(3, jig.shortest_mm / 40)
    planes: list[PlaneFit] = []
    step = max(1, len(local) // _POINTS_AT_FIRST)  # at first some thousands of points are enough
    members = [(local[::step], near[::step])] * 3
    turn = 0
    while turn < _ROUNDS:
        if turn == _ROUNDS - _LAST_ROUNDS:  # from here on all points that may be a face's, and no others
            over_planes = (local @ normals.T - offsets).T
            at_plane = [np.flatnonzero(np.abs(h) <= 2 * band) for h, band in zip(over_planes, bands, strict=True)]
            members = [(local.take(on, axis=0), near[on]) for on in at_plane]
        heights = [points @ normals.T - offsets for points, _ in members]
        if turn == _ROUNDS - 1:
            # Not before: planes fitted to a part of the points have rings off the plane by themselves.
            margins_mm = flat_margins_mm(heights, planes, jig, outline)
        margins_mm = np.maximum(margins_mm, _MARGIN_SIGMA * bands.max() / _BAND_SIGMA)
        planes = []
        for face, (points, indices) in enumerate(members):
            on = _points_of_face(points, heights[face], face, bands[face], margins_mm[face], jig, outline)
            planes.append(fit_plane_robustly(points.take(on, axis=0), indices[on], normals[face], offsets[face]))
        moved = [
            abs(p.offset_mm - d) + jig.longest_mm * np.linalg.norm(p.normal - n)
            for p, n, d in zip(planes, normals, offsets, strict=True)
        ]
        at_rest = all(move < _AT_REST * p.sigma_mm for move, p in zip(moved, planes, strict=True))
        turn = max(turn + 1, _ROUNDS - _LAST_ROUNDS if at_rest else 0)
        normals = np.array([p.normal for p in planes])
        offsets = np.array([p.offset_mm for p in planes])
        bands = np.array([max(_BAND_SIGMA * p.sigma_mm, 1e-6) for p in planes])
    return planes, margins_mm


def _points_of_face(
    points: Array,
    heights: Array,
    face: int,
    band_mm: float,
    margin_mm: float,
    jig: Jig,
    outline: Outline,
) -> IndexArray:
    """Indices of the points on a face, inside its outline less a margin; `heights` (K, 3): of points over all planes.

    Where too few remain, as on a narrow strip, the margin is made smaller. Raises CornerError if that does not help.
    """
    for share in _LESS_MARGIN:
        on = np.flatnonzero(face_points(heights, face, band_mm, jig, outline, share * margin_mm))
        on = on[without_far_points(np.stack(along_edges(heights.take(on, axis=0), face, jig)).T)]
        lack = _lack_of_points(points, on, jig)
        if not lack:
            return on
    raise CornerError(lack)


def _lack_of_points(points: Array, on: IndexArray, jig: Jig) -> str:
    """Reason why a face's points, those with indices `on`, do not define a plane; "" where they do."""
    if len(on) < _FEWEST_POINTS:
        return (
            f"only {len(on)} points on one of the faces, at least {_FEWEST_POINTS} are needed; "
            "turn the jig toward the scanner, or scan it finer"
        )
    some = points.take(on[:: max(1, len(on) // _POINTS_FOR_SPREAD)], axis=0)
    centred = some - some.mean(axis=0)
    # Of points on one line the eigenvalue is zero but for rounding, which may fall below it.
    across = np.sqrt(max(np.linalg.eigvalsh(centred.T @ centred)[1], 0.0) / len(some))
    if across < _LEAST_SPREAD * jig.shortest_mm:
        return (
            f"the {len(on)} points on one of the faces lie along a line ({across:.2g} mm wide); "
            "turn the jig toward the scanner, or scan it finer"
        )
    return ""


def _face(plane: PlaneFit, origin: Array, group: int, covariance: Array, scan_points: int) -> Face:
    """Face of the corner from its fitted plane."""
    return Face(
        normal=plane.normal,
        offset_mm=float(plane.offset_mm + plane.normal @ origin),
        centre_mm=plane.centre_mm + origin,
        points=len(plane.indices),
        rms_mm=plane.sigma_mm,
        inlier_bits=packed(plane.indices, scan_points),
        group=group,
        axes=plane.axes,
        covariance=covariance,
    )
