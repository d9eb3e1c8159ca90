"""From the whole cloud to the points that sample sets are drawn from: one point a voxel, with a normal each.

Normals of a full structured-light cloud take longer than all later steps and improve none of them: a face of the jig
needs some hundreds of normals, not a hundred thousand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from calib.array_types import Array, BoolArray, IndexArray

NEIGHBOURS = 20
TRIM_KEPT = 0.7  # share of the neighbours that the second and third PCA see
_TRIMMED_VARIANCE = 0.310  # of a normal variable cut to its central 70 %
_VOXELS_AN_AXIS = 2**20
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_ENOUGH_POINTS = 75_000
_GOLDEN = 0.618
_ENOUGH_A_VOXEL = 6
_AT_A_TIME = 4096
_BLOCK = 4
_MOST_OF_USUAL = 20
_LOOSE = 0.25
_SURFACE_SHARE = 0.9  # so that up to nine of ten points may be stray
_STRAY_SHARE = 0.04  # a face at 78 deg incidence has a twelfth of the points of one seen squarely


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
        """Median distance between neighbouring points on the surfaces, of `some` of the points (indices or mask)."""
        return float(np.median(self.radius_mm[some]) * np.sqrt(np.pi / self.neighbours.shape[1]))

    def loose(self) -> BoolArray:
        """Mask (V,) of points about which others fill space instead of a surface.

        Uniform stray points have a thickness of 0.2 to 0.4 of the radius, points of a surface one of some hundredths.
        """
        return np.asarray(self.thickness_mm > _LOOSE * self.radius_mm)

    def noise_mm(self) -> float:
        """Noise along the normals in the flat parts of the scene.

        The lower quartile, not the median: edges, curved parts and stray points only make neighbourhoods thicker.
        """
        return float(np.quantile(self.thickness_mm, 0.25)) * 1.1


def thin_to_voxels(points_mm: Array, voxel_mm: float) -> IndexArray:
    """Indices of one point per occupied voxel, voxel by voxel; those that hold stray points are left out.

    points_mm  # (N, 3). Stray points (flying pixels, reflections) fill space thinly where surfaces fill it densely. A
    voxel is left out where the block of 4 x 4 x 4 voxels around holds a twenty-fifth of the points that blocks of
    surfaces hold, and where it has itself far fewer than the median, if that is four or more. Of a scan so fine that a
    part of it fills the voxels as well, only every n-th point is used.
    """
    step = len(points_mm) / _ENOUGH_POINTS
    if step > 2:
        # A step that fits into no row of a scan: otherwise whole columns would be left out.
        some = np.arange(0, len(points_mm) - 1, np.floor(step) + _GOLDEN).astype(np.int64)
        first, count = _occupied(points_mm.take(some, axis=0), voxel_mm)
        if len(first) and np.median(count) >= _ENOUGH_A_VOXEL:
            return np.asarray(some[first])
    return _occupied(points_mm, voxel_mm)[0]


def _occupied(points_mm: Array, voxel_mm: float) -> tuple[IndexArray, IndexArray]:
    """Index of the first point of each voxel that holds no stray points, and how many points the voxel holds."""
    kept = np.flatnonzero(finite_rows(points_mm))
    if len(kept) < len(points_mm):
        points_mm = points_mm[kept]
    if not len(kept):
        return kept, kept
    columns = np.ascontiguousarray(points_mm.T)
    if max(np.ptp(x) for x in columns) >= (_VOXELS_AN_AXIS / 2 - 1) * voxel_mm:
        middle = np.median(points_mm[:: max(1, len(kept) // 10_000)], axis=0)
        inside = np.abs(points_mm - middle).max(axis=1) < (_VOXELS_AN_AXIS / 2 - 1) * voxel_mm
        kept, columns = kept[inside], columns[:, inside]
        if not len(kept):
            return kept, kept
    cell = [((x - x.min()) / voxel_mm).astype(np.int64) for x in columns]
    first, count = _first_of_each(_keys(cell))
    # Thousands of points in one place are no surface, but for example pixels without depth at the scanner's origin.
    count = np.minimum(count, _MOST_OF_USUAL * np.median(count))
    block = np.unique(_keys([x[first] // _BLOCK for x in cell]), return_inverse=True)[1].ravel()
    around = np.bincount(block, count)[block]
    dense = np.argsort(around)
    surface = around[dense[np.searchsorted(np.cumsum(count[dense]), _SURFACE_SHARE * count.sum())]]
    solid = around >= _STRAY_SHARE * surface
    usual = np.median(count[solid])
    if usual >= 4:
        solid &= count >= 0.25 * usual
    return kept[first[solid]], count[solid]


def _keys(cell: Sequence[IndexArray]) -> IndexArray:
    """One integer a cell. cell  # (3, N) from 0"""
    x, y, z = cell
    key = x * (int(y.max()) + 1)
    key += y
    key *= int(z.max()) + 1
    key += z
    return key


def _first_of_each(key: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Where each value of `key` occurs first, in the order of the values, and how often."""
    bits = len(key).bit_length()
    if int(key.max()).bit_length() + bits > 63:
        _, first, count = np.unique(key, return_index=True, return_counts=True)
        return first, count
    # Value and place in one integer: sorting those takes a fifth of the time of sorting places by values.
    packed = np.sort((key << bits) | np.arange(len(key)))
    value = packed >> bits
    start = np.flatnonzero(np.r_[True, value[1:] != value[:-1]])
    return packed[start] & ((1 << bits) - 1), np.diff(start, append=len(key))


def finite_rows(points_mm: Array) -> BoolArray:
    """True where a point has three finite coordinates. points_mm  # (N, 3)"""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.isfinite(points_mm @ np.ones(3)))  # a sum is quicker than all(axis=1)


def estimate_normals(points_mm: Array, neighbours: int = NEIGHBOURS) -> Neighbourhoods:
    """Trimmed PCA: the plane through the nearest `neighbours`, twice fitted again to the best 70 % of them.

    points_mm  # (V, 3), V >= 4. The trimming keeps a normal near an edge on its own side of the edge.
    """
    tree = cKDTree(points_mm, balanced_tree=False, compact_nodes=False)
    distance, near = (np.asarray(found) for found in tree.query(points_mm, k=min(neighbours, len(points_mm))))
    return _neighbourhoods(points_mm, near, distance[:, -1])


def with_fewer_neighbours(around: Neighbourhoods, neighbours: int) -> Neighbourhoods:
    """The same points with normals by the nearest of their neighbours; they need not be looked up again."""
    if neighbours >= around.neighbours.shape[1]:
        return around
    near = around.neighbours[:, :neighbours]
    way = around.points_mm.take(near[:, -1], axis=0) - around.points_mm
    return _neighbourhoods(around.points_mm, near, np.sqrt(np.einsum("vi,vi->v", way, way)))


def _neighbourhoods(points_mm: Array, near: IndexArray, radius_mm: Array) -> Neighbourhoods:
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
    """Planes through the neighbourhoods of the points from `start` on. columns  # (3, V), near  # (V, k)"""
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
    """Weighted PCA of V neighbourhoods at once. local  # (3, V, k), weights  # (V, k)

    The eigenvalues of each 3 x 3 scatter matrix S come in closed form (Smith 1961); the adjugate of S - l I, l the
    least of them, is a multiple of n n^T, whose longest column gives the normal n. It takes a tenth of the time of
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
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
