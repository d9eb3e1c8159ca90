"""Plane groups: passing sample sets that lie on one plane (Jang 2025, section 2.3, processes 1-3 and eq 1).

The first free set founds a group; the others are held against it in one batch (all of them at once, a loop per group,
none per set); those that pass all three processes join. A founder is small, so its normal is off by a degree and the
height tolerance has to be wide; the group's plane is therefore fitted to its members and the sets are held against it
again, more narrowly, before the next group is founded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.planes.filters import SampleSets

_NARROWING = (20.0, 8.0, 5.0)  # height tolerances of the three rounds after the founder's, in units of sigma


@dataclass(frozen=True)
class PlaneGroup:
    """One plane, normal . p = offset_mm, and the sets on it."""

    sets: IndexArray  # (K,) indices into the SampleSets
    centre_mm: Array  # (3,)
    normal: Array  # (3,) unit, toward the scanner
    offset_mm: float


@dataclass(frozen=True)
class ClusterTolerances:
    """When a set belongs to a group."""

    parallel_rad: float  # process 1: largest angle between the normals
    in_plane_rad: (
        float  # process 2: how far from 90 deg the way from centre to centre may be, to both normals
    )
    height_mm: float  # process 3: largest height of a set's centre over the founder
    sigma_mm: float  # noise along the normal: the unit of the later rounds' tolerances


def process_1(normal: Array, normals: Array, parallel_rad: float) -> BoolArray:
    """True where a set's normal is parallel to the group's: n . n_k >= cos(tolerance). normals  # (K, 3)"""
    return normals @ normal >= np.cos(parallel_rad)


def process_2(
    centre_mm: Array,
    normal: Array,
    centroids_mm: Array,
    normals: Array,
    in_plane_rad: float,
    height_mm: float,
) -> BoolArray:
    """True where the way v from the group's centre to the set's is perpendicular to both normals.

    |v . n| <= |v| sin(tolerance), and the same for the set's own normal. Over a short way the noise of the centres
    alone tilts v, so a height below `height_mm` always passes.
    """
    v = centroids_mm - centre_mm
    allowed = np.maximum(np.linalg.norm(v, axis=1) * np.sin(in_plane_rad), height_mm)
    return (np.abs(v @ normal) <= allowed) & (np.abs(np.sum(v * normals, axis=1)) <= allowed)


def process_3(centre_mm: Array, normal: Array, centroids_mm: Array, height_mm: float) -> BoolArray:
    """True where the height difference h = |n . (c_k - c)| (eq 1) lies inside the band. centroids_mm  # (K, 3)"""
    return np.abs((centroids_mm - centre_mm) @ normal) <= height_mm


def cluster(sets: SampleSets, tolerances: ClusterTolerances) -> tuple[PlaneGroup, ...]:
    """Plane groups of the sets that passed the filters, the group with the most sets first.

    Sets found groups in the order of their size: a large set's normal is more exact.
    """
    passed = sets.passed()
    size = np.linalg.norm(sets.points_mm[passed] - sets.centroids_mm[passed, None], axis=2).min(axis=1)
    free = passed[np.argsort(-size, kind="stable")]
    groups = []
    while len(free):
        group = _found_group(sets, free, tolerances)
        groups.append(group)
        free = free[~np.isin(free, group.sets)]
    return tuple(sorted(groups, key=lambda g: -len(g.sets)))


def _found_group(sets: SampleSets, free: IndexArray, tolerances: ClusterTolerances) -> PlaneGroup:
    founder = free[0]
    centre, normal = sets.centroids_mm[founder], sets.normals[founder]
    heights = [tolerances.height_mm, *(k * tolerances.sigma_mm for k in _NARROWING)]
    members = free[:1]
    for height_mm in heights:
        centroids, normals = sets.centroids_mm[free], sets.normals[free]
        joins = process_1(normal, normals, tolerances.parallel_rad)
        joins &= process_2(centre, normal, centroids, normals, tolerances.in_plane_rad, height_mm)
        joins &= process_3(centre, normal, centroids, height_mm)
        if not joins.any():
            break
        members = free[joins]
        centre, normal = fit_plane(sets.points_mm[members].reshape(-1, 3), toward=normal)
    # The founder stays a member even where it is off the fitted plane, or it would found the same group again.
    members = np.union1d(members, founder)
    return PlaneGroup(members, centre, normal, float(normal @ centre))


def fit_plane(points_mm: Array, toward: Array) -> tuple[Array, Array]:
    """Centre and unit normal of the total-least-squares plane through (N, 3) points, on the side of `toward`."""
    centre = points_mm.mean(axis=0)
    centred = points_mm - centre
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    return centre, normal if normal @ toward >= 0 else -normal
