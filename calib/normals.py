"""From the whole cloud to the points that sample sets are drawn from: one point a voxel, with a normal each.

Normals of a full structured-light cloud cost more than everything after them, and say no more: a face of the jig
needs some hundreds of normals, not a hundred thousand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

NEIGHBOURS = 20
TRIM_KEPT = 0.7  # share of the neighbours that the second and third PCA see
# Variance of a normal variable cut to its central 70 %, and the 3 of the plane's degrees of freedom taken off.
_TRIMMED_VARIANCE = 0.310 * (14 - 3) / 14
_VOXELS_AN_AXIS = 2**20


@dataclass(frozen=True)
class Neighbourhoods:
    """Thinned points, each with the plane through its neighbours."""

    points_mm: NDArray  # (V, 3)
    normals: NDArray  # (V, 3) unit, toward the scanner
    thickness_mm: NDArray  # (V,) noise along the normal, as the neighbours show it
    normal_sigma_rad: NDArray  # (V,) the normal's own uncertainty
    tree: cKDTree  # of points_mm

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
    middle = np.nanmedian(points_mm, axis=0)
    cells = (points_mm - middle) / voxel_mm
    near = np.flatnonzero(np.all(np.abs(cells) < _VOXELS_AN_AXIS / 2 - 1, axis=1))
    cell = np.floor(cells[near]).astype(np.int64) + _VOXELS_AN_AXIS // 2
    key = (cell[:, 0] * _VOXELS_AN_AXIS + cell[:, 1]) * _VOXELS_AN_AXIS + cell[:, 2]
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    usual = np.median(count) if len(count) else 0
    if usual >= 4:
        first = first[count >= 0.25 * usual]
    return near[np.sort(first)]


def estimate_normals(points_mm: NDArray) -> Neighbourhoods:
    """Trimmed PCA: the plane through the nearest points, twice fitted again to the best 70 % of them.

    points_mm  # (V, 3), V >= 4. The trimming keeps a normal near an edge on its own side of the edge.
    """
    tree = cKDTree(points_mm)
    k = min(NEIGHBOURS, len(points_mm))
    _, near = tree.query(points_mm, k=k)
    local = points_mm[near] - points_mm[:, None]  # (V, k, 3)
    kept = max(4, round(TRIM_KEPT * k))
    values, vectors, middle = _principal_axes(local)
    for _ in range(2):
        height = np.abs(np.einsum("vki,vi->vk", local - middle[:, None], vectors[:, :, 0]))
        best = np.argpartition(height, kept - 1, axis=1)[:, :kept]
        values, vectors, middle = _principal_axes(np.take_along_axis(local, best[:, :, None], axis=1))
    normals = vectors[:, :, 0]
    normals = np.where(np.sum(normals * points_mm, axis=1, keepdims=True) > 0, -normals, normals)
    thickness = np.sqrt(np.maximum(values[:, 0], 0) / _TRIMMED_VARIANCE)
    spread = np.sqrt(np.maximum(values[:, 1], 1e-300))
    sigma_rad = thickness / (spread * np.sqrt(kept))
    return Neighbourhoods(points_mm, normals, thickness, sigma_rad, tree)


def _principal_axes(local: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Eigenvalues (V, 3) ascending, eigenvectors (V, 3, 3) in columns, and means (V, 3) of (V, k, 3) points."""
    middle = local.mean(axis=1)
    centred = local - middle[:, None]
    scatter = np.matmul(centred.transpose(0, 2, 1), centred) / local.shape[1]
    values, vectors = np.linalg.eigh(scatter)
    return values, vectors, middle
