"""Plane groups: passing sample sets that lie on one plane (Jang 2025, section 2.3, processes 1-3 and eq 1).

The first free set founds a group; the others are compared with it in one batch (all of them at once, a loop per group,
none per set); those that pass all three processes join. A founder is small, so its normal is off by a degree and the
height tolerance has to be wide; the group's plane is therefore fitted to its members and the sets are compared with
that plane again, in narrower tolerances, before the next group is founded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.brief import Brief
from calib.planes.filters import SampleSets

_NARROWING = (20.0, 8.0, 5.0)  # height tolerances of the three rounds after the founder's, in units of sigma


@dataclass(frozen=True)
class PlaneGroup(Brief):
    """Plane normal . p = offset_mm, and the sample sets on it."""

    sets: IndexArray  # (K,) indices into the SampleSets
    centre_mm: Array  # (3,)
    normal: Array  # (3,) unit, toward the scanner
    offset_mm: float


@dataclass(frozen=True)
class ClusterTolerances:
    """Tolerances within which a sample set belongs to a group."""

    parallel_rad: float  # process 1: largest angle between the normals
    in_plane_rad: float  # process 2: how far from 90 deg the way from centre to centre may be, to both normals
    height_mm: float  # process 3: largest height of a set's centre over the founder
    sigma_mm: float  # noise along the normal: the unit of the later rounds' tolerances


def process_1(normal: Array, normals: Array, parallel_rad: float) -> BoolArray:
    """Mask (K,): whether sets' normals (K, 3) are parallel to the group's: n . n_k >= cos(tolerance)."""
    return normals @ normal >= np.cos(parallel_rad)


def process_2(
    centre_mm: Array, normal: Array, centroids_mm: Array, normals: Array, in_plane_rad: float, height_mm: float
) -> BoolArray:
    """Mask (K,): whether the vector v from the group's centre to each set's centroid is perpendicular to both normals.

    |v . n| <= |v| sin(tolerance), and alike for the set's own normal. Over a short distance the noise of the centres
    alone tilts v, so a height below `height_mm` always passes.
    """
    v = centroids_mm - centre_mm
    allowed = np.maximum(np.linalg.norm(v, axis=1) * np.sin(in_plane_rad), height_mm)
    return (np.abs(v @ normal) <= allowed) & (np.abs(np.sum(v * normals, axis=1)) <= allowed)


def process_3(centre_mm: Array, normal: Array, centroids_mm: Array, height_mm: float) -> BoolArray:
    """Mask (K,): the height difference h = |n . (c_k - c)| (eq 1) of sets' centroids (K, 3) is within `height_mm`."""
    return np.abs((centroids_mm - centre_mm) @ normal) <= height_mm


def cluster(sets: SampleSets, tolerances: ClusterTolerances) -> tuple[PlaneGroup, ...]:
    """Plane groups of the sets that passed the filters, the group with the most sets first.

    Sets found groups in the order of their size: the normal of a large set is more exact.
    """
    passed = sets.passed()
    size = np.linalg.norm(sets.points_mm[passed] - sets.centroids_mm[passed, None], axis=2).min(axis=1)
    free = _FreeSets.of(sets, passed[np.argsort(-size, kind="stable")])
    groups = []
    while len(free.sets):
        joins, centre, normal = _found_group(free, tolerances)
        groups.append(PlaneGroup(np.sort(free.sets[joins]), centre, normal, float(normal @ centre)))
        free = free.without(joins)
    return tuple(sorted(groups, key=lambda g: -len(g.sets)))


@dataclass(frozen=True)
class _FreeSets:
    """Sets that belong to no group yet, with the moments from which planes through some of them are fitted."""

    sets: IndexArray  # (K,) the next founder first
    centroids_mm: Array  # (K, 3)
    normals: Array  # (K, 3)
    moments: Array  # (K, 12) of the four points, x from `origin_mm`: the means of x and of all nine of x x^T
    origin_mm: Array  # (3,)

    @staticmethod
    def of(sets: SampleSets, order: IndexArray) -> _FreeSets:
        """The free sets with the indices `order`, with the moments of their points."""
        centroids = sets.centroids_mm[order]
        origin = np.median(centroids, axis=0) if len(order) else np.zeros(3)
        points = sets.points_mm[order] - origin
        second = np.matmul(points.transpose(0, 2, 1), points).reshape(-1, 9) / points.shape[1]
        return _FreeSets(order, centroids, sets.normals[order], np.hstack([centroids - origin, second]), origin)

    def without(self, joins: IndexArray) -> _FreeSets:
        """The free sets that the mask `joins` does not select."""
        stay = np.ones(len(self.sets), dtype=bool)
        stay[joins] = False
        return _FreeSets(
            self.sets[stay], self.centroids_mm[stay], self.normals[stay], self.moments[stay], self.origin_mm
        )

    def plane(self, members: IndexArray, toward: Array) -> tuple[Array, Array]:
        """Centre and unit normal, on `toward`'s side, of the total-least-squares plane through the members' points."""
        mean = np.full(len(members), 1 / len(members)) @ self.moments.take(members, axis=0)
        middle = mean[:3]
        normal = np.linalg.eigh(mean[3:].reshape(3, 3) - np.outer(middle, middle))[1][:, 0]
        return self.origin_mm + middle, normal if normal @ toward >= 0 else -normal


def _found_group(free: _FreeSets, tolerances: ClusterTolerances) -> tuple[IndexArray, Array, Array]:
    """Members of the first free set's group (indices into the free sets), its centre and its normal."""
    centre, normal = free.centroids_mm[0], free.normals[0]
    heights = [tolerances.height_mm, *(k * tolerances.sigma_mm for k in _NARROWING)]
    members = np.zeros(1, dtype=np.int64)
    for height_mm in heights:
        joins = np.flatnonzero(process_1(normal, free.normals, tolerances.parallel_rad))
        centroids = free.centroids_mm.take(joins, axis=0)
        near = np.flatnonzero(process_3(centre, normal, centroids, height_mm))
        joins, centroids = joins[near], centroids.take(near, axis=0)
        normals = free.normals.take(joins, axis=0)
        joins = joins[process_2(centre, normal, centroids, normals, tolerances.in_plane_rad, height_mm)]
        if not len(joins):
            break
        members = joins
        centre, normal = free.plane(members, toward=normal)
        if len(members) == 1:
            break  # narrower tolerances add nothing
    # The founder stays a member even where it is off the fitted plane, or it would found the same group again.
    return members if members[0] == 0 else np.r_[0, members], centre, normal


def off_planes(
    groups: Sequence[PlaneGroup],
    points_mm: Array,
    height_mm: float,
    normals: Array | None = None,
    parallel_rad: float = np.pi,
) -> BoolArray:
    """Mask (V,): whether points (V, 3) lie on none of the groups' planes.

    With normals (V, 3), a plane counts only for points whose own normal is parallel to its normal.
    """
    off = np.ones(len(points_mm), dtype=bool)
    for group in groups:
        on = np.abs(points_mm @ group.normal - group.offset_mm) <= height_mm
        off &= ~(on if normals is None else on & process_1(group.normal, normals, parallel_rad))
    return off
