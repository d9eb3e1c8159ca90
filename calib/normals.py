"""From the whole cloud to the points that sample sets are drawn from: one point a voxel, with a normal each.

Normals of a full structured-light cloud cost more than everything after them, and say no more: a face of the jig
needs some hundreds of normals, not a hundred thousand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

NEIGHBOURS = 20
TRIM_KEPT = 0.7  # share of the neighbours that the second and third PCA see
# Variance of a normal variable cut to its central 70 %, and the 3 of the plane's degrees of freedom taken off.
_TRIMMED_VARIANCE = 0.310 * (14 - 3) / 14
_VOXELS_AN_AXIS = 2**20
_MOST_COUNTERS = 8e6


@dataclass(frozen=True)
class Neighbourhoods:
    """Thinned points, each with the plane through its neighbours."""

    points_mm: NDArray  # (V, 3)
    normals: NDArray  # (V, 3) unit, toward the scanner
    thickness_mm: NDArray  # (V,) noise along the normal, as the neighbours show it
    normal_sigma_rad: NDArray  # (V,) the normal's own uncertainty
    neighbours: NDArray  # (V, k) indices of the nearest points, the point itself first
    reach_mm: float  # median radius of a neighbourhood

    def noise_mm(self) -> float:
        """Noise along the normals in the flat parts of the scene.

        The lower quartile, not the median: creases, curved parts and stray points only ever thicken a neighbourhood.
        """
        return float(np.quantile(self.thickness_mm, 0.25)) * 1.1


def thin_to_voxels(points_mm: NDArray, voxel_mm: float) -> NDArray:
    """Indices of one point per occupied voxel; voxels with far fewer points than the usual are left out.

    points_mm  # (N, 3). Flying pixels and stray points mostly live in those sparse voxels. Where the scan has about
    one point a voxel (less than four at the median) nothing can be called sparse, and all are kept.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        finite = np.flatnonzero(np.isfinite(points_mm @ np.ones(3)))  # a sum is quicker than all(axis=1)
    if not len(finite):
        return finite
    middle = np.median(points_mm[finite[:: max(1, len(finite) // 10_000)]], axis=0)
    cells = (points_mm[finite] - middle) / voxel_mm
    if np.abs(cells).max() >= _VOXELS_AN_AXIS / 2 - 1:
        inside = np.abs(cells).max(axis=1) < _VOXELS_AN_AXIS / 2 - 1
        finite, cells = finite[inside], cells[inside]
    near, cell = finite, np.floor(cells).astype(np.int64)
    if not len(near):
        return near
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    key = (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]
    if (
        float(np.prod(size.astype(float))) <= _MOST_COUNTERS
    ):  # a table of all voxels: much faster than sorting
        table = np.bincount(key)
        count = table[table > 0]
        table[key[::-1]] = np.arange(len(key))[::-1]  # the first point of a voxel is written last
        occupied = np.zeros(len(table), dtype=bool)
        occupied[key] = True
        first = table[occupied]
    else:
        _, first, count = np.unique(key, return_index=True, return_counts=True)
    usual = np.median(count) if len(count) else 0
    if usual >= 4:
        first = first[count >= 0.25 * usual]
    return near[np.sort(first)]


def estimate_normals(points_mm: NDArray) -> Neighbourhoods:
    """Trimmed PCA: the plane through the nearest points, twice fitted again to the best 70 % of them.

    points_mm  # (V, 3), V >= 4. The trimming keeps a normal near an edge on its own side of the edge.
    """
    k = min(NEIGHBOURS, len(points_mm))
    tree = cKDTree(points_mm, balanced_tree=False, compact_nodes=False)
    distance, near = (np.asarray(found) for found in tree.query(points_mm, k=k))
    local = np.ascontiguousarray(np.moveaxis(points_mm[near] - points_mm[:, None], 2, 0))  # (3, V, k)
    kept = max(4, round(TRIM_KEPT * k))
    plane = _fit_planes(local, np.ones((len(points_mm), k)))
    for _ in range(2):
        height = np.abs(np.einsum("cvk,vc->vk", local, plane.normals) - plane.offsets[:, None])
        cut = np.partition(height, kept - 1, axis=1)[:, kept - 1, None]
        plane = _fit_planes(local, (height <= cut).astype(float))
    away = np.sum(plane.normals * points_mm, axis=1, keepdims=True) > 0
    thickness = np.sqrt(plane.variances[:, 0] / _TRIMMED_VARIANCE)
    sigma_rad = thickness / np.sqrt(np.maximum(plane.variances[:, 1], 1e-12) * kept)
    return Neighbourhoods(
        points_mm,
        np.where(away, -plane.normals, plane.normals),
        thickness,
        sigma_rad,
        near,
        float(np.median(distance[:, -1])),
    )


class _Planes(NamedTuple):
    """Planes n . p = d through V neighbourhoods."""

    normals: NDArray  # (V, 3)
    offsets: NDArray  # (V,)
    variances: NDArray  # (V, 2) along the normal, and the smaller one within the plane


def _fit_planes(local: NDArray, weights: NDArray) -> _Planes:
    """Weighted PCA of V neighbourhoods at once. local  # (3, V, k), weights  # (V, k)

    The eigenvalues of each 3 x 3 scatter matrix come in closed form (Smith 1961), the normal as the longest cross
    product of two rows of S - l I. It takes a tenth of the time of LAPACK's loop over matrices, and is exact enough:
    the error is that of rounding relative to the largest eigenvalue.
    """
    total = weights.sum(axis=1)
    weighted = local * weights
    mean = weighted.sum(axis=2) / total  # (3, V)
    scatter = np.empty((len(total), 3, 3))
    for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        moment = np.einsum("vk,vk->v", weighted[a], local[b]) / total - mean[a] * mean[b]
        scatter[:, a, b] = scatter[:, b, a] = moment
    middle = np.trace(scatter, axis1=1, axis2=2) / 3
    deviator = scatter - middle[:, None, None] * np.eye(3)
    size = np.sqrt(np.maximum(np.einsum("vab,vab->v", deviator, deviator), 1e-300) / 6)
    (a, b, c), (_, d, e), (*_, f) = np.moveaxis(deviator / size[:, None, None], 0, 2)
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    angle = np.arccos(np.clip(determinant / 2, -1, 1)) / 3
    least = middle + 2 * size * np.cos(angle + 2 * np.pi / 3)
    largest = middle + 2 * size * np.cos(angle)
    rows = scatter - least[:, None, None] * np.eye(3)
    crosses = np.cross(rows[:, [0, 1, 2]], rows[:, [1, 2, 0]])  # (V, 3, 3)
    lengths = np.linalg.norm(crosses, axis=2)
    best = np.argmax(lengths, axis=1)[:, None]
    length = np.take_along_axis(lengths, best, axis=1)
    normals = np.take_along_axis(crosses, best[:, :, None], axis=1)[:, 0] / np.maximum(length, 1e-300)
    normals = np.where(length > 0, normals, [0.0, 0.0, 1.0])  # all points in one place: any direction will do
    variances = np.maximum(np.stack([least, 3 * middle - least - largest], axis=1), 0)
    return _Planes(normals, np.einsum("cv,vc->v", mean, normals), variances)
