"""Finder of three-faced jigs: `find_corner`, repeatedly where several are in view.

Each corner that was found is taken out of the scan before the next search. Jigs of several sizes are identified by how
far their faces reach.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.corners.intersection import Corner, packed
from calib.corners.search import CornerOptions, CornerSearch, find_corner
from calib.errors import TargetError
from calib.jig import FACE_PAIRS, Jig
from calib.scans.scan import Scan
from calib.targets.protocol.finder import FoundPoint, Wanted

_TAKEN_OUT = 0.95  # of the longest edge: radius of the ball of points that a found jig takes with it
_BALL_AT = 0.4  # of the longest edge: from the apex to its middle, along the jig's axis
_ONE_PLACE_MM = 5.0
_STEP = 0.05  # of the edge, in which the faces' reach is measured
_EMPTY = 0.3  # of the density near the apex: beyond the face
_SIZE_SLACK = 0.12
_BAND_SIGMA = 6.0


def find_jigs(scan: Scan, wanted: Wanted, shapes: int) -> tuple[CornerSearch, list[FoundPoint]]:
    """First search for a jig with its intermediate products, and the corners of at most as many jigs as are wanted.

    `shapes` is the number of different jigs that may be in view. Raises TargetError where none is found.
    """
    jig = wanted.shape
    assert isinstance(jig, Jig)
    options = CornerOptions(declared=wanted.declared)
    searches: list[CornerSearch] = []
    found: list[FoundPoint] = []
    first: CornerSearch | None = None
    remaining = np.arange(len(scan.points_mm))
    refusal = ""
    for _ in range(wanted.most + shapes - 1 + (1 if wanted.most > 1 else 0)):
        rest = Scan(scan.name, scan.points_mm[remaining])
        search = find_corner(rest, jig, scan_sigma_mm=wanted.scan_sigma_mm, options=options)
        searches.append(search)
        corner = search.corner
        if corner is None:
            break
        reach = reach_mm(rest.points_mm, corner, jig) if shapes > 1 else jig.longest_mm
        if abs(reach - jig.longest_mm) < _SIZE_SLACK * jig.longest_mm:
            found.append(_found(corner, remaining, len(scan.points_mm)))
            first = first or _in_whole_scan(search, remaining, len(scan.points_mm))
            if len(found) == wanted.most:
                break
        else:
            refusal = f"a corner is in view whose faces reach {reach:.3g} mm, the jig has {jig.edges_text()}; "
            refusal += "check edge_mm"
        remaining = remaining[~_of_jig(rest.points_mm, corner, jig)]
    if not found:
        raise TargetError(refusal or searches[0].failure)
    return first or searches[0], found


def _found(corner: Corner, remaining: IndexArray, count: int) -> FoundPoint:
    """Place of a corner; `remaining` are the indices in the scan of the points that were searched."""
    inliers = np.concatenate([remaining[face.inliers] for face in corner.faces])
    return FoundPoint(
        corner.xyz_mm,
        corner.covariance_mm2,
        len(inliers),
        max(face.rms_mm for face in corner.faces),
        packed(inliers, count),
        doubts=corner.quality.doubts(),
    )


def _in_whole_scan(search: CornerSearch, remaining: IndexArray, count: int) -> CornerSearch:
    """Search with its faces' inliers as indices into the whole scan."""
    corner = search.corner
    assert corner is not None
    if len(remaining) == count:
        return search
    one, two, three = (replace(face, inlier_bits=packed(remaining[face.inliers], count)) for face in corner.faces)
    return replace(search, corner=replace(corner, faces=(one, two, three)))


def _edges(corner: Corner) -> Array:
    """Unit vectors (3, 3), one per row, along the edges from the apex; edge i is the one that is not in face i."""
    normals = np.array([face.normal for face in corner.faces])
    edges = np.zeros((3, 3))
    for i, j in FACE_PAIRS:
        k = 3 - i - j
        along = np.cross(normals[i], normals[j])
        middle = corner.faces[i].centre_mm + corner.faces[j].centre_mm - 2 * corner.xyz_mm
        edges[k] = along / np.linalg.norm(along) * (1 if along @ middle > 0 else -1)
    return edges


def _of_jig(points: Array, corner: Corner, jig: Jig) -> BoolArray:
    """Mask (N,) of the points that are taken out of the scan with a jig."""
    axis = _edges(corner).sum(axis=0)
    middle = corner.xyz_mm + _BALL_AT * jig.longest_mm * axis / np.linalg.norm(axis)
    return np.linalg.norm(points - middle, axis=1) < _TAKEN_OUT * jig.longest_mm


def reach_mm(points: Array, corner: Corner, jig: Jig) -> float:
    """Distance from the apex to which a corner's faces extend along the edges: the median of three faces.

    On a face the points are p = apex + u e_1 + v e_2. On a triangle u + v ends at the edge's length, on a rectangle the
    larger of u and v does. The end is where the density falls below a third of that near the apex.
    """
    edges = _edges(corner)
    away = points - corner.xyz_mm
    near = away[np.einsum("ni,ni->n", away, away) < (4 * jig.longest_mm) ** 2]
    reaches = []
    for face in range(3):
        on = np.abs(near @ corner.faces[face].normal) < _BAND_SIGMA * max(corner.faces[face].rms_mm, 1e-6)
        first, second = ((face + 1) % 3, (face + 2) % 3)
        along = np.linalg.lstsq(edges[[first, second]].T, near[on].T, rcond=None)[0]
        along = along[:, (along > 0).all(axis=0)]
        span = along.max(axis=0) if corner.outline.rectangular else along.sum(axis=0)
        counts = np.histogram(span, bins=np.arange(0.0, 4.0, _STEP) * jig.longest_mm)[0]
        density = counts / (np.arange(len(counts)) + 0.5)
        usual = float(np.median(density[2:8])) if len(span) else 0.0
        beyond = np.flatnonzero(density[3:] < _EMPTY * usual)
        bin_ = 3 + int(beyond[0]) if len(beyond) else len(counts)
        reaches.append((bin_ - 0.0) * _STEP * jig.longest_mm)
    return float(np.median(reaches))
