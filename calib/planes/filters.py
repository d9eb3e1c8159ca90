"""Sample sets: four points each, and the three filters that decide which of them lie on one plane (Jang 2025, 2.2).

A passing set is a small piece of a plane: its points, its centroid and the mean normal of its four triangles. The
paper draws the four points from the whole scan; there one set in 8000 passes filter 1 in a scene with background. Here
the sets are drawn among neighbours, at two scales: the small one fits into a narrow face, the large one, which grows
with the noise, gives a more exact normal. All sets pass the filters in one batch, as arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.array_types import Array, BoolArray, ByteArray, IndexArray
from calib.brief import Brief

PASSED = 0
SHORT_WALK, LONG_WALK = 2, 8  # steps from neighbour to neighbour: as far as 36 and 160 nearest points reach
_LONGEST_WALK = 60
_PAIRS = tuple(combinations(range(4), 2))
_TRIANGLES = tuple(combinations(range(4), 3))


@dataclass(frozen=True)
class SampleSets(Brief):
    """M sample sets of four points, and the filter that rejected each."""

    points_mm: Array  # (M, 4, 3)
    centroids_mm: Array  # (M, 3)
    # (M, 3) of sets that passed, unit: mean of the four triangles' normals, on the side of the points' own normals
    normals: Array
    rejected_by: ByteArray  # (M,) 0 = passed, 1, 2, 3 = the filter that rejected it

    def __len__(self) -> int:
        return len(self.rejected_by)

    def passed(self) -> IndexArray:
        """Indices of the sets that passed all filters."""
        return np.flatnonzero(self.rejected_by == PASSED)


@dataclass(frozen=True)
class FilterTolerances:
    """Tolerances of the three filters."""

    distance_mm: tuple[float, float]  # filter 1: least and largest distance of a point from the set's centroid
    point_normals_rad: float  # filter 2: largest angle between two points' own normals
    triangle_normals_rad: float  # filter 3: largest angle of a triangle's normal to the points' mean normal


def draw_sample_sets(
    neighbours: IndexArray,
    count: int,
    rng: np.random.Generator,
    *,
    long_walk: int = LONG_WALK,
    local: bool = True,
    around: IndexArray | None = None,
) -> IndexArray:
    """Indices (count, 4) of the points of each drawn sample set.

    neighbours  # (V, k) indices of each point's nearest points. `local` draws each set around a random point, or one of
    the points `around` (K,), by four walks from neighbour to neighbour: of 2 steps for half of the sets, of `long_walk`
    steps for the other half. Otherwise the four points come from the whole cloud, as in the paper. A set in which a
    point was drawn twice is left to filter 3, which no such set passes.
    """
    total, k = neighbours.shape
    if not local:
        return rng.integers(total, size=(count, 4))
    parts = []
    for steps in (SHORT_WALK, long_walk):
        middle = rng.integers(total if around is None else len(around), size=(count // 2, 1))
        at = np.repeat(middle if around is None else around[middle], 4, axis=1)
        for turns in rng.integers(k, size=(steps, *at.shape)):
            at = neighbours[at, turns]
        parts.append(at)
    return np.concatenate(parts)


def walk_for(distance_mm: float, step_mm: float) -> int:
    """Number of steps, at least 8, of a random walk between points within `step_mm` that ends `distance_mm` away (RMS).

    One step leads r / sqrt(2) away, n steps sqrt(n) times as far.
    """
    return int(np.clip(2 * (distance_mm / max(step_mm, 1e-9)) ** 2, LONG_WALK, _LONGEST_WALK))


def filter_1(points_mm: Array, distance_mm: tuple[float, float]) -> BoolArray:
    """Mask (M,): whether all distances of a set's points (M, 4, 3) from its centroid lie inside the range."""
    distance = _length(points_mm - _middle(points_mm)[:, None])
    return np.all((distance >= distance_mm[0]) & (distance <= distance_mm[1]), axis=1)


def filter_2(point_normals: Array, tolerance_rad: float) -> BoolArray:
    """Mask (M,): whether the own normals (M, 4, 3) of a set's points agree pairwise: n_i . n_j >= cos(tolerance)."""
    gram = np.matmul(point_normals, point_normals.transpose(0, 2, 1))
    least = np.min([gram[:, i, j] for i, j in _PAIRS], axis=0)
    return least >= np.cos(tolerance_rad)


def filter_3(triangles: Array, point_normals: Array, tolerance_rad: float) -> BoolArray:
    """Mask (M,): all four triangles' normals agree with the mean of the point normals: |t_i . n| >= cos(tolerance).

    Rejects points on two parallel faces, whose own normals agree. triangles, point_normals  # (M, 4, 3) unit.
    """
    dots = np.einsum("mtc,mc->mt", triangles, _unit(_middle(point_normals)))
    return np.all(np.abs(dots) >= np.cos(tolerance_rad), axis=1)


def triangle_normals(points_mm: Array) -> Array:
    """Unit normals (M, 4, 3) of the four triangles of each set's points; zero for a triangle without area."""
    corners = [[points_mm[:, corner] for corner in triangle] for triangle in _TRIANGLES]
    return _unit(np.stack([np.cross(b - a, c - a) for a, b, c in corners], axis=1))


def apply_filters(points_mm: Array, point_normals: Array, tolerances: FilterTolerances) -> SampleSets:
    """Sample sets with the first of filters 1, 2 and 3 that rejected each, or none.

    points_mm, point_normals  # (M, 4, 3)
    """
    rejected_by = np.zeros(len(points_mm), dtype=np.uint8)
    remaining = np.arange(len(points_mm))

    def reject(number: int, passed: BoolArray) -> None:
        nonlocal remaining
        rejected_by[remaining[~passed]] = number
        remaining = remaining[passed]

    reject(1, filter_1(points_mm, tolerances.distance_mm))
    reject(2, filter_2(point_normals.take(remaining, axis=0), tolerances.point_normals_rad))
    triangles, own = triangle_normals(points_mm.take(remaining, axis=0)), point_normals.take(remaining, axis=0)
    passed = filter_3(triangles, own, tolerances.triangle_normals_rad)
    reject(3, passed)
    triangles, mean = triangles[passed], _middle(own[passed])
    side = np.sign(np.einsum("mtc,mc->mt", triangles, mean))  # a triangle's normal may point to either side
    normals = np.zeros((len(points_mm), 3))
    normals[remaining] = _unit(np.einsum("mtc,mt->mc", triangles, side))
    return SampleSets(points_mm, _middle(points_mm), normals, rejected_by)


def _middle(of_four: Array) -> Array:
    """Mean (M, 3) of the four vectors (M, 4, 3) of each set."""
    return 0.25 * np.einsum("mkc->mc", of_four)


def _length(vectors: Array) -> Array:
    """Lengths (M, K) of vectors (M, K, 3), or (M,) of (M, 3)."""
    return np.sqrt(np.einsum("...c,...c->...", vectors, vectors))


def _unit(vectors: Array) -> Array:
    """Vectors scaled to length 1 along the last axis; vectors of length zero stay zero."""
    length = _length(vectors)[..., None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 1e-12)
