"""Outline of a face (triangle or rectangle of its two edges from the apex), and the points inside the outline.

A point's coordinates along the two edges, from the apex, are its heights over the two other faces. They tell how much
of a face is seen, and which points of the scan belong to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.jig import Jig, Outline
from calib.lazy_modules import spatial
from calib.planes.robust_fit import TUKEY, PlaneFit

_CELLS = 12  # cells along an edge when a face's area is counted
_COLLAR = 0.25  # of the edge
_BORDER = 0.06  # of the edge: nearer to a border points are neither on one side of it nor on the other
_FEW = 6  # points in a strip, at least, to be compared with another
_SOLID = 0.5  # of the points that a cell of a surface has; a cell with more is a surface
_NEAR_POINT = 0.8  # spacings; a square grid leaves no place farther than 0.71 from a point
# Margins to choose from, of the edge.
_RINGS = (1 / 200, 1 / 120, 1 / 80, 1 / 60, 1 / 40, 1 / 30, 1 / 20, 1 / 12)
_RING_SIGMA = 3.5  # mean height of a ring of points along the edges, in its sigmas, beyond which the edge is rounded
_FARTHEST = 4.0  # standard deviations of the points across a face
_PEELINGS = 4


@dataclass(frozen=True)
class FaceOutline:
    """Outline of one face: the lengths of its two edges, and whether these span a rectangle or a triangle."""

    legs_mm: tuple[float, float]
    rectangular: bool = False

    @staticmethod
    def of(outline: Outline, face: int) -> FaceOutline:
        """Outline of one of the jig's faces; its two edges come in the order of the two other faces."""
        one, other = (length for i, length in enumerate(outline.edges_mm) if i != face)
        return FaceOutline((one, other), outline.rectangular)

    def inward(self, one: Array, other: Array) -> Array:
        """Distances, mm, to the face's nearest border, positive inside, of points at `one` and `other` on its edges."""
        a, b = self.legs_mm
        if self.rectangular:
            return np.minimum(np.minimum(one, other), np.minimum(a - one, b - other))
        return np.minimum(np.minimum(one, other), (1 - one / a - other / b) / np.hypot(1 / a, 1 / b))


def along_edges(heights: Array, face: int, jig: Jig) -> tuple[Array, Array]:
    """Coordinates, mm from the apex, of points along a face's two edges, by their heights (K, 3) over three planes.

    Along an edge the heights fall (convex) or rise (concave) away from the apex.
    """
    one, other = (heights[:, i] for i in range(3) if i != face)
    return (-one, -other) if jig.convex else (one, other)


def face_points(heights: Array, face: int, band_mm: float, jig: Jig, outline: Outline, margin_mm: float) -> BoolArray:
    """Mask of the points in the band around a face's plane and inside its outline, less a margin along all edges.

    heights  # (K, 3) over the three planes
    """
    one, other = along_edges(heights, face, jig)
    inside = FaceOutline.of(outline, face).inward(one, other) > margin_mm
    return inside & (np.abs(heights[:, face]) <= band_mm)


def without_far_points(along_mm: Array) -> BoolArray:
    """Mask of a face's points that are not far from its other points; `along_mm` (K, 2): coordinates along the edges.

    Where only a part of a face is seen, a stray point far from it would tilt the plane by its lever alone. Measured by
    the covariance of the points, no point of an evenly covered triangle is farther than sqrt(8) from their middle.
    """
    kept = np.ones(len(along_mm), dtype=bool)
    one, other = np.ascontiguousarray(along_mm.T)
    for _ in range(_PEELINGS):
        weight = kept.astype(float)
        total = weight.sum()
        if total < 4:
            break
        x, y = one - weight @ one / total, other - weight @ other / total
        weighted = weight * x
        xx, xy, yy = weighted @ x / total, weighted @ y / total, (weight * y) @ y / total
        tiny = 1e-12 * (xx + yy) + 1e-18  # points on a line, or in one place
        xx, yy = xx + tiny, yy + tiny
        within = yy * (x * x) - (2 * xy) * (x * y) + xx * (y * y) < _FARTHEST**2 * (xx * yy - xy * xy)
        if np.array_equal(within, kept):
            break
        kept = within
    return kept


def flat_margins_mm(heights: Sequence[Array], planes: Sequence[PlaneFit], jig: Jig, outline: Outline) -> Array:
    """Least margins (3,) along the edges beyond which the faces are flat.

    heights  # of each face's points (K, 3) over all faces. A rounded edge lowers the points next to it, and the ring of
    points along the edges where the rounding begins lies within the noise point by point, but not as a whole. The rings
    are tried from the inside out; all faces as one, as an edge's rounding is, and each by itself: pixels that see
    across the edge reach far into a face that is seen at a flat angle.
    """
    margins_mm = np.array(_RINGS) * jig.shortest_mm
    total, count = (
        np.array(sums)
        for sums in zip(*(_rings(h, i, planes[i], jig, outline) for i, h in enumerate(heights)), strict=True)
    )
    common = _innermost_off(total.sum(axis=0), count.sum(axis=0))
    own = [_innermost_off(total[face], count[face]) for face in range(len(planes))]
    return np.asarray(margins_mm[np.maximum(common, own)])


def flat_margin_mm(heights: Array, face: int, plane: PlaneFit, jig: Jig, outline: Outline) -> float:
    """Least margin, mm, along a face's edges beyond which it is flat; `heights` (K, 3): its points over all planes."""
    return float(_RINGS[_innermost_off(*_rings(heights, face, plane, jig, outline))] * jig.shortest_mm)


def _rings(heights: Array, face: int, plane: PlaneFit, jig: Jig, outline: Outline) -> tuple[Array, Array]:
    """Sum of heights, in sigmas, and number of a face's points in each ring between margins along its edges."""
    margins_mm = np.array(_RINGS) * jig.shortest_mm
    inward = FaceOutline.of(outline, face).inward(*along_edges(heights, face, jig))
    z = heights[:, face] / plane.sigma_mm
    on = (np.abs(z) < TUKEY) & (inward > margins_mm[0])
    ring = np.searchsorted(margins_mm, inward[on])
    total = np.bincount(ring, z[on], len(margins_mm) + 1).astype(float)
    return total, np.bincount(ring, minlength=len(margins_mm) + 1).astype(float)


def _innermost_off(total: Array, count: Array) -> int:
    """Index of the least margin beyond which the mean height of every ring is within its noise."""
    off = np.flatnonzero(np.abs(total[1:-1]) > _RING_SIGMA * np.sqrt(count[1:-1]))
    return int(off[-1]) + 1 if len(off) else 0


def filled_share(along_mm: Array, face: FaceOutline, spacing_mm: float = 0.0) -> float:
    """Share of a face's area that has points, which is no less than the filled share of `outline_shares`.

    along_mm and spacing_mm as there.
    """
    on = _in_cells(along_mm[:, 0] / face.legs_mm[0], along_mm[:, 1] / face.legs_mm[1], _CELLS)
    return float(_filled(on, along_mm, face, spacing_mm).sum() / _inside(face.rectangular).sum())


def outline_shares(
    along_mm: Array, agrees: BoolArray, through_mm: Array, face: FaceOutline, spacing_mm: float = 0.0
) -> tuple[float, float, float]:
    """Shares of a face's area: filled with points, with points beyond its edges, and seen through by rays.

    along_mm # (K, 2) coordinates of the plane's points along the face's two edges, from the apex; agrees # (K,) whether
    a point's own normal is that of the plane, without which it is not counted as spilt: it may belong to what the plane
    cuts. Only points in a collar around the face count as spilt; farther off the plane may touch other things.
    through_mm  # (M, 2) where the rays of points behind the plane went through it.

    All areas are counted in cells of a twelfth of each edge, so that the density of the points does not matter. A cell
    with more points behind it than on it is seen through, unless it has half of the points that a surface has there:
    the points behind were then seen from another place, as in a mesh of several views. In a scan whose points are
    `spacing_mm` apart a cell between two of them is filled too.
    """
    cell_mm = np.array(face.legs_mm) / _CELLS
    a, b = along_mm.T / np.array(face.legs_mm)[:, None]
    margin = 0.5 / _CELLS
    spills = agrees & ((a < -margin) | (b < -margin) | _beyond(a, b, face, 1.5 * margin))
    spills &= (a > -_COLLAR) & (b > -_COLLAR) & ~_beyond(a, b, face, np.sqrt(2) * _COLLAR)
    spilt = np.count_nonzero(_in_cells(a[spills] + 1, b[spills] + 1, 3 * _CELLS))
    on = _in_cells(a, b, _CELLS)
    behind = _in_cells(through_mm[:, 0] / face.legs_mm[0], through_mm[:, 1] / face.legs_mm[1], _CELLS)
    inside = _inside(face.rectangular)
    cells = int(inside.sum())  # whole ones
    open_ = (behind > on) & (on < _SOLID * float(np.prod(cell_mm)) / max(spacing_mm, 1e-9) ** 2)
    filled = int(np.sum(_filled(on, along_mm, face, spacing_mm) & ~open_))
    seen_through = int(np.sum(inside & open_))
    points_a_cell = float(on[inside].sum()) / max(filled, 1)  # below one, a point counts for several cells
    area = _CELLS**2 if face.rectangular else _CELLS**2 / 2
    spilt_area = spilt / min(1.0, max(points_a_cell, 0.1)) / area
    goes_on = _goes_on(a[agrees], b[agrees]) if face.rectangular else 0.0
    return filled / cells, max(float(spilt_area), goes_on), seen_through / cells


def _goes_on(a: Array, b: Array) -> float:
    """Extent, 0 to 1, to which a rectangle's plane continues beyond either far border; 0 where below a half.

    a, b  # (K,) of the plane's points, in shares of the legs. Strips on both sides of a border are compared by their
    points, so that no density matters. A longer box has the corner of a shorter one, and one end where it ends too.
    """
    return max(share_beyond(a, b), share_beyond(b, a))


def share_beyond(along: Array, across: Array) -> float:
    """Number of points just beyond a face's border over that just inside, at most 1; 0 where the ratio is below 0.5."""
    along_border = (across > _BORDER) & (across < 1 - _BORDER)
    within = int(np.count_nonzero(along_border & (along > 1 - _COLLAR) & (along < 1 - _BORDER)))
    beyond = int(np.count_nonzero(along_border & (along > 1 + _BORDER) & (along < 1 + _COLLAR)))
    return min(1.0, beyond / within) if within >= _FEW and beyond > 0.5 * within else 0.0


@cache
def _inside(rectangular: bool) -> BoolArray:
    """Mask of the cells that lie completely in a face, a rectangle or a triangle."""
    row, column = np.indices((_CELLS, _CELLS))
    return (row + column <= _CELLS - 2) | rectangular


def _in_cells(a: Array, b: Array, count: int) -> IndexArray:
    """Number of points in each of (count, count) cells, a twelfth of a leg wide; a, b: coordinates over leg lengths."""
    row, column = a * _CELLS, b * _CELLS
    within = (row >= 0) & (column >= 0) & (row < count) & (column < count)
    cell = row[within].astype(np.int64) * count + column[within].astype(np.int64)
    return np.bincount(cell, minlength=count**2).reshape(count, count)


def _beyond(a: Array, b: Array, face: FaceOutline, by: float) -> BoolArray:
    """Mask of points farther than `by` beyond the face's far border; a, b and `by` in shares of the legs."""
    return np.asarray(np.maximum(a, b) > 1 + by / np.sqrt(2) if face.rectangular else a + b > 1 + by)


def _filled(on: IndexArray, along_mm: Array, face: FaceOutline, spacing_mm: float) -> BoolArray:
    """Mask of a face's cells that have points (K, 2), or are as near to a point as a surface's points to each other."""
    inside = _inside(face.rectangular)
    filled = inside & (on > 0)
    cell_mm = np.array(face.legs_mm) / _CELLS
    reach_mm = _NEAR_POINT * spacing_mm
    if reach_mm > 0.5 * cell_mm.min() and len(along_mm):
        empty = np.argwhere(inside & ~filled)
        tree = spatial.cKDTree(along_mm, balanced_tree=False, compact_nodes=False)
        distance = np.asarray(tree.query((empty + 0.5) * cell_mm, distance_upper_bound=reach_mm)[0])
        filled[tuple(empty[distance < reach_mm].T)] = True
    return np.asarray(filled)
