"""Normals of a scan's thinned points, from which sample sets are drawn: trimmed PCA of each point's neighbours.

Normals of a full structured-light cloud take longer than all later steps and improve none of them: a face of the jig
needs some hundreds of normals, not a hundred thousand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.lazy_modules import spatial

NEIGHBOURS = 20
TRIM_KEPT = 0.7  # share of the neighbours that the second and third PCA see
_TRIMMED_VARIANCE = 0.310  # of a normal variable cut to its central 70 %
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_AT_A_TIME = 4096
_LOOSE = 0.25


@dataclass(frozen=True)
class Neighbourhoods:
    """Thinned points, each with the plane through its neighbours."""

    points_mm: Array  # (V, 3)
    normals: Array  # (V, 3) unit, toward the scanner
    thickness_mm: Array  # (V,) noise along the normal, from the neighbours' heights
    normal_sigma_rad: Array  # (V,) standard deviation of the normal's direction
    neighbours: IndexArray  # (V, k) indices of the nearest points, the point itself first
    radius_mm: Array  # (V,) distance of the farthest of the neighbours

    def spacing_mm(self, some: IndexArray | BoolArray) -> float:
        """Median distance between neighbouring points on the surfaces, over the points `some` (indices or mask)."""
        return float(np.median(self.radius_mm[some]) * np.sqrt(np.pi / self.neighbours.shape[1]))

    def loose(self) -> BoolArray:
        """Mask (V,) of points whose neighbours fill space instead of a surface.

        Uniform stray points have a thickness of 0.2 to 0.4 of the radius, points of a surface one of some hundredths.
        """
        return self.thickness_mm > _LOOSE * self.radius_mm

    def noise_mm(self) -> float:
        """Standard deviation of the noise along the normals in the flat parts of the scene.

        From the lower quartile, not the median: edges, curved parts and stray points only make neighbourhoods thicker.
        """
        return float(np.quantile(self.thickness_mm, 0.25)) * 1.1


def estimate_normals(points_mm: Array, neighbours: int = NEIGHBOURS) -> Neighbourhoods:
    """Neighbourhoods of points (V, 3), V >= 4, with normals by PCA, trimmed twice to the best 70 % of the neighbours.

    The trimming keeps a normal near an edge on its own side of the edge.
    """
    tree = spatial.cKDTree(points_mm, balanced_tree=False, compact_nodes=False)
    distance, near = (np.asarray(found) for found in tree.query(points_mm, k=min(neighbours, len(points_mm))))
    return _neighbourhoods(points_mm, near, distance[:, -1])


def with_fewer_neighbours(around: Neighbourhoods, neighbours: int) -> Neighbourhoods:
    """Neighbourhoods of the same points with fewer neighbours each, which need not be looked up again."""
    if neighbours >= around.neighbours.shape[1]:
        return around
    near = around.neighbours[:, :neighbours]
    way = around.points_mm.take(near[:, -1], axis=0) - around.points_mm
    return _neighbourhoods(around.points_mm, near, np.sqrt(np.einsum("vi,vi->v", way, way)))


def _neighbourhoods(points_mm: Array, near: IndexArray, radius_mm: Array) -> Neighbourhoods:
    """Neighbourhoods from points (V, 3), indices of their neighbours (V, k) and the distance (V,) of the farthest."""
    kept = max(4, round(TRIM_KEPT * near.shape[1]))
    columns = np.ascontiguousarray(points_mm.T)
    # Some at a time, whose neighbours, side by side, a processor's own memory holds.
    parts = [_trimmed_planes(columns, near, start, kept) for start in range(0, len(near), _AT_A_TIME)]
    plane = _Planes(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    away = np.einsum("vi,vi->v", plane.normals, points_mm)[:, None] > 0
    freedom = max(kept - 3, 1) / kept  # the plane takes three degrees of freedom
    thickness = np.sqrt(plane.variances[:, 0] / (_TRIMMED_VARIANCE * freedom))
    sigma_rad = thickness / np.sqrt(np.maximum(plane.variances[:, 1], 1e-12) * kept)
    normals = np.where(away, -plane.normals, plane.normals)
    return Neighbourhoods(points_mm, normals, thickness, sigma_rad, near, radius_mm)


def _trimmed_planes(columns: Array, near: IndexArray, start: int, kept: int) -> _Planes:
    """Planes by trimmed PCA through the neighbours `near` (V, k) of one batch of points, from `start` on."""
    stop = start + _AT_A_TIME
    local = np.stack([x[near[start:stop]] - x[start:stop, None] for x in columns])  # (3, B, k)
    plane = _fit_planes(local, np.ones(local.shape[1:]))
    for _ in range(2):
        height = np.abs(np.einsum("cvk,vc->vk", local, plane.normals) - plane.offsets[:, None])
        cut = np.partition(height, kept - 1, axis=1)[:, kept - 1, None]
        plane = _fit_planes(local, (height <= cut).astype(float))
    return plane


class _Planes(NamedTuple):
    """Planes n . p = d through V neighbourhoods."""

    normals: Array  # (V, 3)
    offsets: Array  # (V,)
    variances: Array  # (V, 2) along the normal, and the smaller one within the plane


def _fit_planes(local: Array, weights: Array) -> _Planes:
    """Planes by weighted PCA of V neighbourhoods at once; `local` (3, V, k), `weights` (V, k).

    The eigenvalues of each 3 x 3 scatter matrix S come in closed form (Smith 1961); the adjugate of S - l I, l the
    least of them, is a multiple of n n^T, whose longest column gives the normal n. This takes a tenth of the time of
    LAPACK's loop over matrices, and is exact enough: the error is that of rounding relative to the largest eigenvalue.
    """
    total = weights.sum(axis=1)
    weighted = local * weights
    mean = weighted.sum(axis=2) / total  # (3, V)
    xx, xy, xz, yy, yz, zz = (
        np.einsum("vk,vk->v", weighted[a], local[b]) / total - mean[a] * mean[b] for a, b in _UPPER
    )
    middle = (xx + yy + zz) / 3
    squares = (xx - middle) ** 2 + (yy - middle) ** 2 + (zz - middle) ** 2 + 2 * (xy**2 + xz**2 + yz**2)
    size = np.sqrt(np.maximum(squares, 1e-300) / 6)
    deviator = (column / size for column in (xx - middle, xy, xz, yy - middle, yz, zz - middle))
    angle = np.arccos(np.clip(_determinant(*deviator) / 2, -1, 1)) / 3
    least = middle + 2 * size * np.cos(angle + 2 * np.pi / 3)
    largest = middle + 2 * size * np.cos(angle)
    xx, yy, zz = xx - least, yy - least, zz - least
    adjugate = np.empty((3, 3, len(total)))
    adjugate[0, 0], adjugate[1, 1], adjugate[2, 2] = yy * zz - yz**2, xx * zz - xz**2, xx * yy - xy**2
    adjugate[0, 1] = adjugate[1, 0] = xz * yz - xy * zz
    adjugate[0, 2] = adjugate[2, 0] = xy * yz - xz * yy
    adjugate[1, 2] = adjugate[2, 1] = xy * xz - xx * yz
    best = np.argmax(np.einsum("aav->av", adjugate), axis=0)
    column = np.take_along_axis(adjugate, best[None, None], axis=1)[:, 0].T  # (V, 3)
    length = np.linalg.norm(column, axis=1, keepdims=True)
    normals = np.where(length > 0, column / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])  # in one place: any
    variances = np.maximum(np.stack([least, 3 * middle - least - largest], axis=1), 0)
    return _Planes(normals, np.einsum("cv,vc->v", mean, normals), variances)


def _determinant(xx: Array, xy: Array, xz: Array, yy: Array, yz: Array, zz: Array) -> Array:
    """Determinants (V,) of symmetric 3 x 3 matrices given by their six entries."""
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
