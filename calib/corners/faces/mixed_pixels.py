"""Correction of pixels that see across an edge of the jig, for coarse scans where these are a large share of a face.

A pixel reports a mean over what it sees, and a scanner smooths over neighbouring pixels. Near an edge that rounds the
corner off. Where a face is many pixels wide its margins leave such points out; on a face seen at a flat angle, a few
pixels wide, they are too many to be left out and too many for robust weights. But what they report follows from the
planes: along each line of sight the inverse range to plane i is linear in the direction, q_i = n_i . way / d_i, and a
convex corner shows the smallest q_i. So a pixel on face i that takes the share w_k of each neighbour k is off by the
sum of w_k (min_j q_j - q_i) over the neighbours' directions: linear in the shares, which are the same for all pixels.
The shares are estimated from all three faces, and the points are moved back along their rays accordingly.

This is done only where it explains the points: shares that a pixel can give away, and all rings of points along all
edges flat afterwards. A bevel or a rounding fails that: it has one width in mm, not one in pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.corners.faces.face_outline import FaceOutline, along_edges, flat_margin_mm
from calib.jig import Jig, Outline
from calib.lazy_modules import spatial
from calib.planes.robust_fit import TUKEY, PlaneFit
from calib.statistics import mad_sigma

_NEIGHBOURS = (
    ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)),
    ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)),
    ((2.0, 0.0), (-2.0, 0.0), (0.0, 2.0), (0.0, -2.0)),
)
"""Neighbours of a pixel, in pixels; those of a row have equal shares, one unknown."""
_SHARES = len(_NEIGHBOURS)
_NEXT = (0, 1)  # the rows of the eight pixels around
_RING = 0.5  # pixels
_RINGS = 4  # along an edge
_EDGE_PIXELS = 1.2  # along an edge that mix with what lies beyond, for a mean direction of the edge
_UNSURE = 0.25  # pixels from an edge within which a pixel may look at either face
_BESIDE_BORDER = 1.6  # pixels along a face's outer border that are left out: they mix with what lies far behind
_NARROW = 0.1  # share of a face's pixels next to its edges, beyond which leaving them out costs too much
_MOST_POINTS = 1_500  # a face with more is wide enough for margins, or too finely seen to matter
_POINTS_A_FACE = 20_000
_PRIOR = 0.1  # standard deviation of a share
_LEAST_SIGMAS = 5.0  # of all shares together
_MOST_GIVEN_AWAY = 0.65  # of a pixel; what gives more away is smoothed farther than these neighbours
# Mean squared height of a ring in its own sigmas: bevels leave 3 to 120, mixed pixels 0.3 to 2.2.
_MOST_MISFIT = 2.5
_GAIN = 6.0  # that the squared residuals must fall by
_BAND_SIGMA = 12.0
_BAND_SHARE = 0.15  # of a neighbour: points that are off by this are still looked at
_REWEIGHTINGS = 12
_GRID_POINTS = 2_000  # side by side, enough to find the grid
_ROUNDS = 3
_MARGIN_SIGMA = 3.0
_SAME_WEIGHTS = 1e-3  # weights that change less are those of the solution


@dataclass(frozen=True)
class PixelGrid:
    """Directions of the scanner's pixels near the jig: a square grid of one pitch."""

    steps: Array  # (2, 3) from pixel to pixel, rad; across the line of sight

    @property
    def pitch_rad(self) -> float:
        """Angle from pixel to pixel."""
        return float(np.linalg.norm(self.steps[0]))


def pixel_grid(seen_mm: Array, middle_mm: Array) -> PixelGrid | None:
    """Pixel grid from a surface's points (N, 3) about its middle (3,), scanner frame; None where there are too few.

    Where the points lie on no square grid any direction will do: the shares are then a mean over directions.
    """
    if len(seen_mm) > _GRID_POINTS:
        away = np.sum((seen_mm - middle_mm) ** 2, axis=1)
        seen_mm = seen_mm[np.argpartition(away, _GRID_POINTS)[:_GRID_POINTS]]
    if len(seen_mm) < 2:
        return None
    ways = seen_mm / np.linalg.norm(seen_mm, axis=1)[:, None]
    across = np.linalg.svd(ways.mean(axis=0)[None])[2][1:]
    seen_at = ways @ across.T
    tree = spatial.cKDTree(seen_at, balanced_tree=False, compact_nodes=False)
    distance, nearest = (np.asarray(found) for found in tree.query(seen_at, k=2))
    pitch_rad = float(np.median(distance[:, 1]))
    if not pitch_rad > 0:
        return None
    usual = np.abs(distance[:, 1] - pitch_rad) < 0.2 * pitch_rad
    x, y = (seen_at[nearest[:, 1]] - seen_at)[usual].T
    quarter = np.angle(np.sum(((x + 1j * y) / np.hypot(x, y)) ** 4)) / 4  # a quarter turn leaves a square grid as it is
    turn = np.array([[np.cos(quarter), np.sin(quarter)], [-np.sin(quarter), np.cos(quarter)]])
    return PixelGrid(pitch_rad * turn @ across)


FitFace = Callable[[Array, Array, IndexArray, int, float], PlaneFit]
"""Fit of one face from points (K, 3), their heights (K, 3), their indices (K,), the face and its margin (mm)."""


class _Sight(NamedTuple):
    """Points as ranges and unit directions from the scanner."""

    ranges_mm: Array  # (N,)
    ways: Array  # (N, 3) unit


@dataclass(frozen=True)
class MixedPixels:
    """Shares by which pixels mix with their neighbours, and the faces so narrow that their points need a correction."""

    shares: Array  # (3,) of a neighbour at 1, sqrt(2), 2 pixels
    grid: PixelGrid
    faces: BoolArray  # (3,) whether the face's points are to be moved back


def refit_narrow_faces(
    local: Array,
    near: IndexArray,
    planes: Sequence[PlaneFit],
    margins_mm: Array,
    origin: Array,
    jig: Jig,
    outline: Outline,
    fit: FitFace,
) -> tuple[list[PlaneFit], Array]:
    """Three planes, narrow faces fitted to points corrected for pixel mixing, and margins (3,) left out at edges.

    local  # (N, 3) about origin (3,), near  # (N,) their indices. Planes and margins are returned as given where no
    pixels mix or no face is narrow. Raises CornerError as `fit` does.
    """
    refitted, margins = list(planes), np.array(margins_mm, dtype=float)
    for _ in range(_ROUNDS):
        mixed = find_mixed_pixels(local, refitted, origin, jig, outline)
        if mixed is None:
            return list(planes), np.asarray(margins_mm)
        heights = np.column_stack([local @ plane.normal - plane.offset_mm for plane in refitted])
        after = list(planes)
        for face in np.flatnonzero(mixed.faces).tolist():
            plane = refitted[face]
            moved = moved_back(local, refitted, face, origin, jig, mixed)
            over = heights.copy()
            over[:, face] = moved @ plane.normal - plane.offset_mm
            clear = seen_on_face(local, refitted, face, origin, mixed.grid, jig, outline)
            rows = np.flatnonzero(clear & (np.abs(over[:, face]) < _BAND_SIGMA * plane.sigma_mm))
            margins[face] = max(flat_margin_mm(over[rows], face, plane, jig, outline), _MARGIN_SIGMA * plane.sigma_mm)
            after[face] = fit(moved[rows], over[rows], near[rows], face, float(margins[face]))
        refitted = after
    return refitted, margins


def find_mixed_pixels(
    local: Array, planes: Sequence[PlaneFit], origin: Array, jig: Jig, outline: Outline
) -> MixedPixels | None:
    """Mixing of neighbouring pixels, estimated from points near the jig's edges; None where no face needs a correction.

    local  # (N, 3) points about `origin` (3,), the first estimate of the apex, in the scanner's frame.
    """
    if min(len(plane.indices) for plane in planes) > _MOST_POINTS:
        return None
    widest = max(planes, key=lambda plane: len(plane.indices))
    grid = pixel_grid(widest.points_mm + origin, widest.centre_mm + origin)
    if grid is None:
        return None
    rows, values, places = [], [], []
    narrow = np.array([_edge_share(planes, face, origin, grid, jig, outline) > _NARROW for face in range(3)])
    if not narrow.any():
        return None
    heights = np.column_stack([local @ plane.normal - plane.offset_mm for plane in planes])
    for face, plane in enumerate(planes):
        on = np.flatnonzero(FaceOutline.of(outline, face).inward(*along_edges(heights, face, jig)) > 0)
        on = on[seen_on_face(local.take(on, axis=0), planes, face, origin, grid, jig, outline)]
        on = on[:: max(1, len(on) // _POINTS_A_FACE)]
        seen = _sight(local.take(on, axis=0), origin)
        moves = _range_moves(seen, planes, face, origin, grid, jig) * (seen.ways @ plane.normal)[:, None]
        band_mm = _BAND_SIGMA * plane.sigma_mm + _BAND_SHARE * np.abs(moves[:, _NEXT]).sum(axis=1)
        near = np.abs(heights[on, face]) < band_mm
        on, moves, seen = on[near], moves[near], _Sight(seen.ranges_mm[near], seen.ways[near])
        row = np.zeros((len(on), 9 + _SHARES))
        row[:, 3 * face : 3 * face + 3] = plane.design(local[on])
        row[:, 9:] = moves
        rows.append(row / plane.sigma_mm)
        values.append(heights[on, face] / plane.sigma_mm)
        places.append(_rings(seen, planes, face, origin, grid))
    if min(len(value) for value in values) <= 3:
        return None
    solution, covariance, residuals = _robust_solution(np.concatenate(rows), np.concatenate(values))
    shares = solution[9:]
    given_away = 4 * float(shares.sum())
    certain = float(shares @ np.linalg.solve(covariance[9:, 9:], shares))
    if certain < _LEAST_SIGMAS**2 or not 0 < given_away < _MOST_GIVEN_AWAY:
        return None
    if _misfit(places, np.split(residuals, np.cumsum([len(row) for row in rows])[:-1])) > _MOST_MISFIT:
        return None
    if sum(_gain(rows[face], values[face], shares, face) for face in range(3)) < _GAIN:
        return None
    return MixedPixels(shares, grid, narrow)


def moved_back(
    local: Array, planes: Sequence[PlaneFit], face: int, origin: Array, jig: Jig, mixed: MixedPixels
) -> Array:
    """Points (N, 3) of a face moved along their rays to undo the change of range by mixing across the face's edges."""
    sight = _sight(local, origin)
    pulls = _range_moves(sight, planes, face, origin, mixed.grid, jig) @ mixed.shares
    return local - pulls[:, None] * sight.ways


def seen_on_face(
    local: Array, planes: Sequence[PlaneFit], face: int, origin: Array, grid: PixelGrid, jig: Jig, outline: Outline
) -> BoolArray:
    """Mask (N,) of the points whose pixels certainly see the face, and nothing that lies far behind it.

    They are a part of a pixel away from the two edges, and some pixels inside the outer border.
    """
    corners = _outline_corners(planes, face, origin, jig, outline)
    ways = _sight(local, origin).ways
    clear = np.ones(len(local), dtype=bool)
    inside = 1 if jig.convex else -1  # of a convex corner a ray meets the face that it shows last
    for side, angle in _beside_edges(ways, planes, face, origin):
        clear &= inside * side * angle > _UNSURE * grid.pitch_rad
    for start, stop in pairwise(corners[1:]):
        inward = np.cross(start, stop)
        inward *= np.sign(inward @ corners[0]) / np.linalg.norm(inward)
        clear &= ways @ inward > _BESIDE_BORDER * grid.pitch_rad
    return clear


def _outline_corners(planes: Sequence[PlaneFit], face: int, origin: Array, jig: Jig, outline: Outline) -> Array:
    """Corners (3, 3) or, for a rectangle, (4, 3) of a face in the scanner's frame, the apex first."""
    normals = np.array([plane.normal for plane in planes])
    apex = np.linalg.solve(normals, np.array([plane.offset_mm for plane in planes])) + origin
    ends = []
    for i in range(3):
        if i == face:
            continue
        edge = np.cross(normals[(i + 1) % 3], normals[(i + 2) % 3])
        edge *= (-1 if jig.convex else 1) * np.sign(normals[i] @ edge) / np.linalg.norm(edge)
        ends.append(apex + outline.edges_mm[i] * edge)
    between = [ends[0] + ends[1] - apex] if outline.rectangular else []
    return np.array([apex, ends[0], *between, ends[1]])


def _edge_share(
    planes: Sequence[PlaneFit], face: int, origin: Array, grid: PixelGrid, jig: Jig, outline: Outline
) -> float:
    """Share of a face's pixels that lie next to one of its two edges, from its outline alone."""
    corners = _outline_corners(planes, face, origin, jig, outline)
    axes = grid.steps / grid.pitch_rad**2
    x, y = axes @ (corners / np.linalg.norm(corners, axis=1)[:, None]).T  # pixels
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    edges = np.hypot(x[1] - x[0], y[1] - y[0]) + np.hypot(x[-1] - x[0], y[-1] - y[0])
    return float(_EDGE_PIXELS * edges / max(area, 1e-12))


def _sight(local: Array, origin: Array) -> _Sight:
    """Ranges and directions of points given about `origin` (3,), scanner frame."""
    seen = local + origin
    ranges_mm = np.linalg.norm(seen, axis=1)
    return _Sight(ranges_mm, seen / ranges_mm[:, None])


def _inverse_ranges(planes: Sequence[PlaneFit], origin: Array) -> Array:
    """Matrix (3, 3) whose product with a unit ray is the inverse range (1/mm) at which the ray meets each plane."""
    return np.array([plane.normal / (plane.offset_mm + plane.normal @ origin) for plane in planes])


def _range_moves(
    sight: _Sight, planes: Sequence[PlaneFit], face: int, origin: Array, grid: PixelGrid, jig: Jig
) -> Array:
    """Changes (N, 3), mm, of points' ranges by full mixing (share 1) with neighbours 1, sqrt(2) and 2 pixels away."""
    inverse = _inverse_ranges(planes, origin)
    others = inverse - inverse[face]
    here, steps = others @ sight.ways.T, others @ grid.steps.T  # (3, N), (3, 2): of q_j - q_i
    moves = np.empty((_SHARES, here.shape[1]))
    for row, places in enumerate(_NEIGHBOURS):
        there = [here + (steps @ place)[:, None] for place in np.array(places)]
        seen = [np.min(q, axis=0) if jig.convex else np.max(q, axis=0) for q in there]
        moves[row] = -np.sum(seen, axis=0)
    return np.asarray((moves * sight.ranges_mm**2).T)


def _beside_edges(ways: Array, planes: Sequence[PlaneFit], face: int, origin: Array) -> list[tuple[Array, Array]]:
    """Side (1 or -1) and angle, rad, at which rays (N, 3) pass each of a face's two edges.

    The side is 1 where the ray meets the other face's plane first.
    """
    inverse = _inverse_ranges(planes, origin)
    sides_and_angles = []
    for other in (i for i in range(3) if i != face):
        kink = inverse[other] - inverse[face]
        along = ways @ kink
        sides_and_angles.append((np.sign(along), np.abs(along) / np.linalg.norm(kink - along[:, None] * ways, axis=1)))
    return sides_and_angles


def _rings(sight: _Sight, planes: Sequence[PlaneFit], face: int, origin: Array, grid: PixelGrid) -> list[IndexArray]:
    """Index (N,), for each of the face's two edges, of the ring, half a pixel wide, along it that a point lies in."""
    return [
        np.minimum(angle / grid.pitch_rad / _RING, _RINGS).astype(int)
        for _, angle in _beside_edges(sight.ways, planes, face, origin)
    ]


def _misfit(places: Sequence[Sequence[IndexArray]], residuals: Sequence[Array]) -> float:
    """Mean squared height of all rings along all edges on all faces, in units of each ring's variance."""
    squares = []
    for edges, z in zip(places, residuals, strict=True):
        near = np.abs(z) < TUKEY
        for ring in edges:
            total, count = (np.bincount(ring[near], w, _RINGS + 1)[:_RINGS] for w in (z[near], None))
            squares.append(total[count > 2] ** 2 / count[count > 2])
    rings = np.concatenate(squares)
    return float(rings.mean()) if len(rings) else np.inf


def _robust_solution(rows: Array, values: Array) -> tuple[Array, Array, Array]:
    """Plane parameters (9,) and mixing shares by Tukey's biweight, their covariance, and residuals over their scale."""
    prior = np.zeros(rows.shape[1])
    prior[9:] = 1 / _PRIOR**2
    prior[:9] = 1e-12
    weights: Array = np.ones(len(values))
    scale = 1.0
    solution: Array = np.zeros(rows.shape[1])
    normal_matrix: Array = np.diag(prior)
    residuals: Array = values
    for _ in range(_REWEIGHTINGS):
        normal_matrix = np.asarray((rows * weights[:, None]).T @ rows + np.diag(prior))
        solution = np.asarray(np.linalg.solve(normal_matrix, rows.T @ (weights * values)), dtype=np.float64)
        residuals = values - rows @ solution
        scale = max(1.0, mad_sigma(residuals))
        before, weights = weights, np.asarray(np.clip(1 - (residuals / (TUKEY * scale)) ** 2, 0, None) ** 2)
        if np.abs(weights - before).max() < _SAME_WEIGHTS:
            break
    return solution, np.asarray(np.linalg.inv(normal_matrix)), np.asarray(residuals / scale)


def _gain(rows: Array, values: Array, shares: Array, face: int) -> float:
    """Decrease of a face's bounded squared residuals by correcting its points for pixel mixing and refitting it."""
    design = rows[:, 3 * face : 3 * face + 3]

    def loss(z: Array) -> float:
        weights = np.ones(len(z))
        residuals = z
        for _ in range(_REWEIGHTINGS):
            weighted = design * weights[:, None]
            residuals = z - design @ np.linalg.lstsq(weighted.T @ design, weighted.T @ z, rcond=None)[0]
            before, weights = weights, np.clip(1 - (residuals / TUKEY) ** 2, 0, None) ** 2
            if np.abs(weights - before).max() < _SAME_WEIGHTS:
                break
        return float(np.sum(TUKEY**2 / 3 * (1 - np.sqrt(weights) ** 3)))

    return loss(values) - loss(values - rows[:, 9:] @ shares)
