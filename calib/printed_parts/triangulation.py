"""Triangles of a plane region with holes, by cutting ears.

Source: D. Eberly, *Triangulation by Ear Clipping* (Geometric Tools, 2002): holes are joined to the outline by bridges,
then one convex vertex after another is cut off whose triangle contains no other vertex.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, BoolArray

_FLAT = 1e-9  # mm2, twice a triangle's area below which its three vertices count as one line


def region_triangles(outline: Array, holes: Sequence[Array] = ()) -> Array:
    """Triangles (T, 3, 2), counter-clockwise, of the region within an outline and outside its holes.

    The triangles have no other vertices than those given, so that walls on the same vertices close without gaps.

    Args:
        outline: (N, 2), counter-clockwise, a simple polygon.
        holes: polygons (M, 2), counter-clockwise, inside the outline and apart from each other.
    """
    points, around = _with_bridges(outline, holes)
    triangles = []
    while len(around) > 3:
        ear = _ear(points, around)
        triangles.append(points[[around[ear - 1], around[ear], around[(ear + 1) % len(around)]]])
        del around[ear]
    triangles.append(points[around])
    return np.array(triangles)


def _with_bridges(outline: Array, holes: Sequence[Array]) -> tuple[Array, list[int]]:
    """All points (P, 2) and the indices of one polygon around them, which goes to each hole and back on a bridge."""
    points = np.concatenate([outline, *holes])
    around = list(range(len(outline)))
    starts = np.cumsum([len(outline), *map(len, holes)])[:-1]
    loops = [list(range(start, start + len(hole))) for start, hole in zip(starts, holes, strict=True)]
    loops.sort(key=lambda loop: -points[loop, 0].max())
    for k, loop in enumerate(loops):
        start = int(np.argmax(points[loop, 0]))
        hole = [loop[(start - i) % len(loop)] for i in range(len(loop))]  # clockwise
        walls = [around, *loops[k:]]
        nearest = np.argsort(np.linalg.norm(points[around] - points[hole[0]], axis=1), kind="stable")
        at = next(int(i) for i in nearest if _sees(points, hole[0], around[int(i)], walls))
        around = [*around[: at + 1], *hole, hole[0], around[at], *around[at + 1 :]]
    return points, around


def _sees(points: Array, one: int, other: int, walls: Sequence[Sequence[int]]) -> bool:
    """Whether the line from one point to another crosses no edge of the polygons."""
    a, b = points[one], points[other]
    for wall in walls:
        c, d = points[wall], points[np.roll(wall, -1)]
        apart = (_doubled_area(a, b, c) * _doubled_area(a, b, d) < 0) & (
            _doubled_area(c, d, a) * _doubled_area(c, d, b) < 0
        )
        shared = np.isin(wall, (one, other)) | np.isin(np.roll(wall, -1), (one, other))
        on_line = (np.abs(_doubled_area(a, b, c)) < _FLAT) & _is_between(a, b, c) & ~np.isin(wall, (one, other))
        if (apart & ~shared).any() or on_line.any():
            return False
    return True


def _is_between(a: Array, b: Array, c: Array) -> BoolArray:
    along = (c - a) @ (b - a)
    return (along > 0) & (along < (b - a) @ (b - a))


def _ear(points: Array, around: Sequence[int]) -> int:
    """Position of the convex vertex with the least pointed triangle that holds no other vertex."""
    here = points[around]
    before, after = np.roll(here, 1, axis=0), np.roll(here, -1, axis=0)
    area = _doubled_area(before, here, after)
    longest = np.max([_squared(here - before), _squared(after - here), _squared(after - before)], axis=0)
    bent = here[area <= _FLAT]  # only these can lie in a triangle of the others
    for k in np.argsort(-area / longest, kind="stable"):
        if area[k] <= _FLAT:
            break
        a, b, c = before[k], here[k], after[k]
        inside = (_doubled_area(a, b, bent) >= -_FLAT) & (_doubled_area(b, c, bent) >= -_FLAT)
        inside &= _doubled_area(c, a, bent) >= -_FLAT
        corners = np.array([a, b, c])
        inside &= ~(bent[:, None] == corners).all(axis=2).any(axis=1)
        if not inside.any():
            return int(k)
    raise AssertionError("the polygon is not simple")


def _squared(rows: Array) -> Array:
    return np.asarray((rows**2).sum(axis=1))


def _doubled_area(a: Array, b: Array, c: Array) -> Array:
    """Twice the signed areas of triangles, positive counter-clockwise; each of a, b, c is (2,) or (N, 2)."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
