"""Closed solids of triangles, made of loops of points: walls between loops, regions within them, pits, fans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array, IndexArray
from calib.brief import Brief
from calib.printed_parts.triangulation import region_triangles

_SAME_MM = 1e-6  # vertices that are nearer than this are one


@dataclass(frozen=True, eq=False)
class Solid(Brief):
    """A closed surface of triangles, counter-clockwise seen from outside."""

    vertices_mm: Array  # (V, 3), part's frame
    faces: IndexArray  # (F, 3), rows of `vertices_mm`

    @property
    def triangles_mm(self) -> Array:
        """Corners (F, 3, 3) of the triangles, part's frame."""
        return np.asarray(self.vertices_mm[self.faces])

    @cached_property
    def volume_mm3(self) -> float:
        """Volume V = sum of a . (b x c) / 6 over the triangles (divergence theorem)."""
        a, b, c = self.triangles_mm.transpose(1, 0, 2)
        return float((a * np.cross(b, c)).sum() / 6)

    @property
    def size_mm(self) -> tuple[float, float, float]:
        """Extents along x, y and z."""
        x, y, z = np.ptp(self.vertices_mm, axis=0)
        return float(x), float(y), float(z)


def solid_of(patches: Sequence[Array]) -> Solid:
    """The solid that patches of triangles (T, 3, 3), mm, enclose together.

    That they close is asserted: each edge belongs to two triangles, which pass it in opposite directions.
    """
    triangles = np.concatenate(patches)
    _, first, index = np.unique(
        np.round(triangles.reshape(-1, 3) / _SAME_MM) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    faces = index.reshape(-1, 3)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there, back = (np.unique(pair, axis=0) for pair in (edges, edges[:, ::-1]))
    assert len(there) == len(edges), "an edge is passed twice in one direction"
    assert np.array_equal(there, back), "the surface has a gap"
    solid = Solid(triangles.reshape(-1, 3)[first], faces)
    assert solid.volume_mm3 > 0, "the surface is inside out"
    return solid


def circle(radius_mm: float, count: int, centre_mm: tuple[float, float] = (0.0, 0.0), *, around: bool = False) -> Array:
    """Points (count, 2) of a circle, counter-clockwise from the x axis, mm.

    around: the polygon stands around the circle and its sides touch it; otherwise its vertices lie on it.
    """
    angles = 2 * np.pi * np.arange(count) / count
    reach = radius_mm / np.cos(np.pi / count) if around else radius_mm
    return np.asarray(centre_mm + reach * np.column_stack([np.cos(angles), np.sin(angles)]))


def triangle_loop(inradius_mm: float, count: int, centre_mm: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Points (count, 2) of an equilateral triangle about its centre, mm, by equal angles from x; a corner on +y.

    The count is a multiple of 12, so that the three corners are among the points.
    """
    assert count % 12 == 0
    angles = 2 * np.pi * np.arange(count) / count
    from_middle = (angles - np.pi / 6) % (2 * np.pi / 3)  # of the sides, whose middles are at 30, 150 and 270 degrees
    from_middle = np.minimum(from_middle, 2 * np.pi / 3 - from_middle)
    reach = inradius_mm / np.cos(from_middle)
    return np.asarray(centre_mm + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


def at_height(flat: Array, z_mm: float) -> Array:
    """Points (..., 2) of a plane as (..., 3) at a height, mm."""
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), z_mm)], axis=-1)


def wall(lower: Array, upper: Array) -> Array:
    """Triangles (2 N, 3, 3) between two loops (N, 3) of equally many points, seen from outside the loops."""
    low, high = np.roll(lower, -1, axis=0), np.roll(upper, -1, axis=0)
    return np.concatenate([np.stack([lower, low, high], axis=1), np.stack([lower, high, upper], axis=1)])


def bore(lower: Array, upper: Array) -> Array:
    """Triangles (2 N, 3, 3) between two loops (N, 3) of equally many points, seen from within the loops."""
    return reversed_sides(wall(lower, upper))


def fan(tip: Array, loop: Array) -> Array:
    """Triangles (N, 3, 3) from a tip (3,) to a counter-clockwise loop (N, 3), seen from the tip's side, above."""
    tips = np.broadcast_to(tip, loop.shape)
    return np.stack([tips, loop, np.roll(loop, -1, axis=0)], axis=1)


def floor(outline: Array, holes: Sequence[Array], z_mm: float) -> Array:
    """Triangles (T, 3, 3) of a region (N, 2) with holes (M, 2) at a height, seen from above."""
    return at_height(region_triangles(outline, holes), z_mm)


def reversed_sides(triangles: Array) -> Array:
    """The same triangles (T, 3, 3), seen from their other side."""
    return np.asarray(triangles[:, ::-1])


def holed_rectangle(low: Array, high: Array, hole: Array | None, z_mm: float) -> Array:
    """Triangles (T, 3, 3) of a rectangle from `low` to `high` (2,) with a convex hole (N, 2), seen from above, mm.

    Only the rectangle's four corners are vertices on its border, so that rectangles side by side fit.
    """
    corners = np.array([[high[0], low[1]], high, [low[0], high[1]], low])
    if hole is None:
        return at_height(corners[[[0, 1, 2], [0, 2, 3]]], z_mm)
    # The hole's extreme points toward each side; between two of them it is seen from the corner between these sides.
    ends = [int(np.argmax(hole @ toward)) for toward in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    out = []
    for k, corner in enumerate(corners[[1, 2, 3, 0]]):
        out.append([corners[k], corner, hole[ends[k]]])
        count = (ends[(k + 1) % 4] - ends[k]) % len(hole)
        for i in range(ends[k], ends[k] + count):
            out.append([corner, hole[(i + 1) % len(hole)], hole[i % len(hole)]])
    return at_height(np.array(out), z_mm)
