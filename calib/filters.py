"""Sample sets: four points each, and the three filters that decide which of them lie on one plane (Jang 2025, 2.2).

A passing set is a small piece of a plane: its points, its centroid and the mean normal of its four triangles. The
paper draws the four points from the whole scan; there one set in 8000 passes filter 1 in a scene with background. Here
the sets are drawn among neighbours, at two scales: the small one fits into a narrow face, the large one gives a normal
that carries across it. All sets pass through the filters in one batch, as arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

PASSED = 0
LOCAL_SCALES = (36, 160)  # neighbours among which a set's points are drawn
_PAIRS = tuple(combinations(range(4), 2))
_TRIANGLES = tuple(combinations(range(4), 3))


@dataclass(frozen=True)
class SampleSets:
    """M sample sets with their fate."""

    points_mm: NDArray  # (M, 4, 3)
    centroids_mm: NDArray  # (M, 3)
    normals: (
        NDArray  # (M, 3) unit: mean of the four triangles' normals, on the side of the points' own normals
    )
    rejected_by: NDArray  # (M,) uint8: 0 = passed, 1, 2, 3 = the filter that rejected it

    def __len__(self) -> int:
        return len(self.rejected_by)

    def passed(self) -> NDArray:
        """Indices of the sets that passed all filters."""
        return np.flatnonzero(self.rejected_by == PASSED)


@dataclass(frozen=True)
class FilterTolerances:
    """What the three filters let through."""

    distance_mm: tuple[
        float, float
    ]  # filter 1: least and largest distance of a point from the set's centroid
    point_normals_rad: float  # filter 2: largest angle between two points' own normals
    triangle_normals_rad: float  # filter 3: largest angle of a triangle's normal to the points' mean normal


def draw_sample_sets(tree: cKDTree, count: int, rng: np.random.Generator, *, local: bool = True) -> NDArray:
    """Indices (count, 4) of the points of each set into the tree's points.

    `local` draws each set around a random point, half of the sets among its 36 nearest, half among its 160 nearest
    points; otherwise the four points come from the whole cloud, as in the paper. A set whose draw hit a point twice is
    left to filter 3, which no such set passes.
    """
    total = tree.n
    if not local:
        return rng.integers(total, size=(count, 4))
    parts = []
    for scale in LOCAL_SCALES:
        size = count // len(LOCAL_SCALES)
        seeds = rng.integers(total, size=size)
        k = min(scale, total)
        _, near = tree.query(tree.data[seeds], k=k)
        chosen = rng.integers(k, size=(size, 3))
        parts.append(np.c_[seeds, np.take_along_axis(near.reshape(size, k), chosen, axis=1)])
    return np.concatenate(parts)


def filter_1(points_mm: NDArray, distance_mm: tuple[float, float]) -> NDArray:
    """True where each point's distance from the set's centroid lies inside the range. points_mm  # (M, 4, 3)."""
    distance = np.linalg.norm(points_mm - points_mm.mean(axis=1, keepdims=True), axis=2)
    return np.all((distance >= distance_mm[0]) & (distance <= distance_mm[1]), axis=1)


def filter_2(point_normals: NDArray, tolerance_rad: float) -> NDArray:
    """True where the four points' own normals agree pairwise: n_i . n_j >= cos(tolerance). # (M, 4, 3)"""
    gram = np.matmul(point_normals, point_normals.transpose(0, 2, 1))
    least = np.min([gram[:, i, j] for i, j in _PAIRS], axis=0)
    return least >= np.cos(tolerance_rad)


def filter_3(triangles: NDArray, point_normals: NDArray, tolerance_rad: float) -> NDArray:
    """True where all four triangles' normals agree with the mean of the point normals: |t_i . n| >= cos(tolerance).

    It catches points on two parallel faces, whose own normals agree. triangles, point_normals  # (M, 4, 3) unit.
    """
    mean = _unit(point_normals.mean(axis=1))
    dots = np.matmul(triangles, mean[:, :, None])[:, :, 0]
    return np.all(np.abs(dots) >= np.cos(tolerance_rad), axis=1)


def triangle_normals(points_mm: NDArray) -> NDArray:
    """Unit normals (M, 4, 3) of the four triangles that each set's points form; zero for a triangle without area."""
    corners = [points_mm[:, list(t)] for t in _TRIANGLES]
    return _unit(np.stack([np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in corners], axis=1))


def apply_filters(points_mm: NDArray, point_normals: NDArray, tolerances: FilterTolerances) -> SampleSets:
    """All sets through filters 1, 2 and 3 in that order; each records the first filter that rejected it.

    points_mm, point_normals  # (M, 4, 3)
    """
    triangles = triangle_normals(points_mm)
    passes = (
        filter_1(points_mm, tolerances.distance_mm),
        filter_2(point_normals, tolerances.point_normals_rad),
        filter_3(triangles, point_normals, tolerances.triangle_normals_rad),
    )
    rejected_by = np.zeros(len(points_mm), dtype=np.uint8)
    for number, passed in reversed(list(enumerate(passes, start=1))):
        rejected_by[~passed] = number
    mean = _unit(point_normals.mean(axis=1))
    side = np.sign(np.matmul(triangles, mean[:, :, None]))  # a triangle's normal has no side of its own
    normals = _unit((triangles * side).mean(axis=1))
    return SampleSets(points_mm, points_mm.mean(axis=1), normals, rejected_by)


def _unit(vectors: NDArray) -> NDArray:
    """Vectors of length 1 along the last axis; those of no length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-12)
