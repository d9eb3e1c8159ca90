"""Scans that were joined of several views of one jig, whole or thinned, from the tests' own ray caster."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.support.scan_scene import make_scene

_APART_RAD = 0.12  # by which views are turned at the most, about each axis


def joined(
    rng: np.random.Generator, views: int, off_mm: float, off_deg: float = 0.0, rays: int = 12_000
) -> tuple[NDArray, NDArray]:
    """Points (N, 3), in any order, of views that are shifted and turned (sigma, each axis), and the apex (3,)."""
    first = make_scene(rng, rays)
    edges = -first.normals.T  # of a square convex jig
    clouds = []
    for view in range(views):
        turn = np.eye(3)
        scene = first
        if view:
            turn = Rotation.from_rotvec(rng.uniform(-_APART_RAD, _APART_RAD, 3)).as_matrix()
            scene = make_scene(rng, rays, rotation=turn @ edges)
        off = Rotation.from_rotvec(np.radians(off_deg) * rng.standard_normal(3)).as_matrix()
        points = (scene.scan.points_mm - scene.apex_mm) @ turn @ off.T
        clouds.append(points + first.apex_mm + off_mm * rng.standard_normal(3))
    return rng.permutation(np.vstack(clouds)), first.apex_mm


def one_per_cell(points_mm: NDArray, cell_mm: float, *, mean: bool = True) -> NDArray:
    """Points (K, 3), one per cubic cell: the mean of those in it, or the first."""
    cells = np.floor((points_mm - points_mm.min(axis=0)) / cell_mm).astype(int)
    _, first, of_cell, count = np.unique(cells, axis=0, return_index=True, return_inverse=True, return_counts=True)
    if not mean:
        return points_mm[first]
    return np.column_stack([np.bincount(of_cell.ravel(), column) / count for column in points_mm.T])
