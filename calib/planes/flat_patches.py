"""Flat patches of a scan: thinned points whose normals agree with their neighbours', and a plane through all points."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from calib.array_types import Array, IndexArray
from calib.lazy_modules import spatial
from calib.planes.normals import NEIGHBOURS, estimate_normals
from calib.planes.point_selection import thin_to_voxels
from calib.planes.robust_fit import PlaneFit, fit_plane_robustly
from calib.statistics import mad_sigma

_VOXELS_A_SIZE = 24
_ALIKE_RAD = np.radians(9)
_HEIGHT = 0.02  # of the size: largest height of a neighbour over the plane of a point
_FEWEST_THINNED = 12
_FEWEST_POINTS = 30
_MOST_PATCHES = 40
_LEAST_SIZE = 0.2  # of the size: a patch that spreads less is left out
_BAND_SIGMA = 12.0
_STEPS_AWAY = 1.2  # voxels from a patch's thinned points to the points that are its


def flat_patches(points: Array, size_mm: float) -> list[PlaneFit]:
    """Planes through the flat patches of points (N, 3) that are about `size_mm` wide or wider, most points first.

    Scanner frame, normals toward the scanner; `indices` count the given points.
    """
    voxel = size_mm / _VOXELS_A_SIZE
    thinned = thin_to_voxels(points, voxel)
    if len(thinned) < NEIGHBOURS:
        return []
    around = estimate_normals(points[thinned])
    first = np.repeat(np.arange(len(thinned)), around.neighbours.shape[1])
    second = around.neighbours.ravel()
    agree = np.einsum("ki,ki->k", around.normals[first], around.normals[second]) > np.cos(_ALIKE_RAD)
    way = around.points_mm[second] - around.points_mm[first]
    height = max(_HEIGHT * size_mm, 4 * around.noise_mm())
    agree &= np.abs(np.einsum("ki,ki->k", way, around.normals[first])) < height
    agree &= ~(around.loose()[first] | around.loose()[second])
    graph = coo_array((np.ones(agree.sum()), (first[agree], second[agree])), shape=(len(thinned), len(thinned)))
    label = connected_components(graph, directed=False)[1]
    count = np.bincount(label)
    tree = spatial.cKDTree(around.points_mm)
    large = count[label] >= _FEWEST_THINNED
    if not large.any():
        return []
    near_mm = _STEPS_AWAY * max(voxel, around.spacing_mm(large))
    reach, nearest = (np.asarray(found) for found in tree.query(points, k=1, distance_upper_bound=near_mm))
    of_point = np.where(np.isfinite(reach), label[np.minimum(nearest, len(label) - 1)], -1)
    patches = []
    for number in np.argsort(-count)[:_MOST_PATCHES]:
        if count[number] < _FEWEST_THINNED:
            break
        of = label == number
        on = np.flatnonzero(of_point == number)
        patch = _patch(points, on, around.points_mm[of], around.normals[of], around.noise_mm())
        if patch is not None and _spread(patch.points_mm) > _LEAST_SIZE * size_mm:
            patches.append(patch)
    return sorted(patches, key=lambda patch: -len(patch.indices))


def _patch(points: Array, on: IndexArray, thinned: Array, normals: Array, noise_mm: float) -> PlaneFit | None:
    """Robust plane through a patch's points `on`; None for few points. `thinned`, `normals` (K, 3) start the fit."""
    normal = np.median(normals, axis=0)
    normal /= np.linalg.norm(normal)
    offset = float(np.median(thinned @ normal))
    for _ in range(3):
        heights = points[on] @ normal - offset
        sigma = max(mad_sigma(heights - np.median(heights)), noise_mm, 1e-6)
        near = on[np.abs(heights) < _BAND_SIGMA * sigma]
        if len(near) < _FEWEST_POINTS:
            return None
        plane = fit_plane_robustly(points[near], near, normal, offset)
        normal, offset = plane.normal, plane.offset_mm
    return plane


def _spread(points: Array) -> float:
    """Width, mm, of the uniform strip that scatters as the points do in their narrower direction: sigma sqrt(12)."""
    some = points[:: max(1, len(points) // 3000)]
    return float(np.sqrt(12 * max(np.linalg.eigvalsh(np.cov(some.T))[1], 0.0)))
