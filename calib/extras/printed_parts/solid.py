"""Solids of triangles by trimesh: convex hulls of rings of points, joined and cut by manifold3d (the extra `parts`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from calib.array_types import Array

if TYPE_CHECKING:
    from trimesh import Trimesh

Mesh: TypeAlias = "Trimesh"  # a closed surface of triangles, counter-clockwise seen from outside, mm
SIDES = 96
"""Sides of a polygon that stands for a circle: a chord of a 60 mm circle is 0.02 mm off."""
HOLE_SIDES = 48
"""Sides of the polygon of a hole or socket."""


def ring(radius_mm: float, z_mm: float, count: int = SIDES) -> Array:
    """Points (count, 3) of a circle about the z axis, mm."""
    angles = 2 * np.pi * np.arange(count) / count
    return at_height(radius_mm * np.column_stack([np.cos(angles), np.sin(angles)]), z_mm)


def ring_around(radius_mm: float, z_mm: float, centre_mm: Sequence[float] = (0.0, 0.0)) -> Array:
    """Points (HOLE_SIDES, 3) of a polygon whose sides touch a circle from outside, mm: room for what is round."""
    return np.array([*centre_mm[:2], 0.0]) + ring(radius_mm / np.cos(np.pi / HOLE_SIDES), z_mm, HOLE_SIDES)


def at_height(flat_mm: Array, z_mm: float) -> Array:
    """Points (N, 2) of a plane as (N, 3) at a height, mm."""
    return np.column_stack([flat_mm, np.full(len(flat_mm), z_mm)])


def hull(*points_mm: Array) -> Mesh:
    """Convex solid around points (N, 3)."""
    from trimesh import Trimesh

    made: Mesh = Trimesh(np.concatenate(points_mm)).convex_hull
    return made


def joined(solids: Sequence[Mesh], less: Sequence[Mesh]) -> Mesh:
    """What belongs to any of some solids and to none of others."""
    from trimesh.boolean import difference, union

    made = difference([union(solids), *less])
    made.merge_vertices(digits_vertex=4)  # STL has float32: what is one point there is one here
    made.update_faces(made.nondegenerate_faces(height=1e-9))
    assert made.is_volume, "the surface has a gap or is inside out"
    return made
