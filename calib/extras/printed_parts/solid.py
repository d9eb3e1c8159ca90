"""Solids of triangles by trimesh: lofts over loops of points, joined and cut by manifold3d (the extra `parts`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calib.array_types import Array

if TYPE_CHECKING:
    from trimesh import Trimesh

Mesh: TypeAlias = "Trimesh"  # a closed surface of triangles, counter-clockwise seen from outside, mm


def circle(radius_mm: float, count: int, centre_mm: tuple[float, float] = (0.0, 0.0), *, around: bool = False) -> Array:
    """Points (count, 2) of a circle, counter-clockwise from the x axis, mm.

    around: the polygon stands around the circle and its sides touch it; otherwise its vertices lie on it.
    """
    angles = 2 * np.pi * np.arange(count) / count
    reach = radius_mm / np.cos(np.pi / count) if around else radius_mm
    return np.asarray(centre_mm + reach * np.column_stack([np.cos(angles), np.sin(angles)]))


def triangle_loop(inradius_mm: float, count: int) -> Array:
    """Points (count, 2) of an equilateral triangle about its centre, mm, by equal angles from x; a corner on +y.

    The count is a multiple of 12, so that the three corners are among the points.
    """
    assert count % 12 == 0
    angles = 2 * np.pi * np.arange(count) / count
    from_middle = (angles - np.pi / 6) % (2 * np.pi / 3)  # of the sides, whose middles are at 30, 150 and 270 degrees
    from_middle = np.minimum(from_middle, 2 * np.pi / 3 - from_middle)
    reach = inradius_mm / np.cos(from_middle)
    return np.asarray(reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


def at_height(flat: Array, z_mm: float) -> Array:
    """Points (..., 2) of a plane as (..., 3) at a height, mm."""
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), z_mm)], axis=-1)


def loft(*loops: Array) -> Mesh:
    """Solid between loops (N, 3) one above the other, convex and counter-clockwise seen from above, mm.

    The points of a loop are joined to those of the next; the lowest and the highest are closed by fans about their
    middles. A tip is a loop whose points are all the same.
    """
    from trimesh import Trimesh

    rings, count = np.array(loops), len(loops[0])
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    here = np.arange(count)
    then, last, middle = (here + 1) % count, count * (len(loops) - 1), len(vertices) - 2
    faces = [
        np.stack([np.full(count, middle), then, here], axis=1),
        np.stack([np.full(count, middle + 1), last + here, last + then], axis=1),
    ]
    for low in range(0, last, count):
        high = low + count
        faces += [
            np.stack([low + here, low + then, high + then], axis=1),
            np.stack([low + here, high + then, high + here], axis=1),
        ]
    made = Trimesh(vertices, np.concatenate(faces))  # equal vertices become one
    made.update_faces(made.nondegenerate_faces(height=1e-9))
    return made


def prism(loop: Array, low_mm: float, high_mm: float) -> Mesh:
    """Solid above a convex loop (N, 2), from one height to another, mm."""
    return loft(at_height(loop, low_mm), at_height(loop, high_mm))


def joined(solids: Sequence[Mesh], less: Sequence[Mesh] = ()) -> Mesh:
    """What belongs to any of some solids and to none of others."""
    from trimesh.boolean import difference, union

    whole = union(solids) if len(solids) > 1 else solids[0]
    made = difference([whole, *less]) if less else whole
    made.merge_vertices(digits_vertex=4)  # STL has float32: what is one point there is one here
    made.update_faces(made.nondegenerate_faces(height=1e-9))
    assert made.is_volume, "the surface has a gap or is inside out"
    return made
