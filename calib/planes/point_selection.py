"""Selection of a scan's points: one per voxel without stray points, points near a place, points with finite values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.statistics import group_numbers

_VOXELS_AN_AXIS = 2**20
_ENOUGH_POINTS = 75_000
_GOLDEN = 0.618
_ENOUGH_A_VOXEL = 6
_BLOCK = 4
_MOST_OF_USUAL = 20
_SURFACE_SHARE = 0.9  # so that up to nine of ten points may be stray
_STRAY_SHARE = 0.04  # a face at 78 deg incidence has a twelfth of the points of one seen squarely
_AT_A_TIME = 32_768  # points; a processor's own memory holds them through all steps


def thin_to_voxels(points_mm: Array, voxel_mm: float) -> IndexArray:
    """Indices of one point per occupied voxel, voxel by voxel; voxels that hold stray points are left out.

    points_mm  # (N, 3). Stray points (flying pixels, reflections) fill space thinly where surfaces fill it densely. A
    voxel is left out where the block of 4 x 4 x 4 voxels around it holds less than a twenty-fifth of the points that
    blocks of surfaces hold, or where it has itself far fewer than the median, if that is four or more. In a scan so
    fine that a part of it fills the voxels as well, only every n-th point is used.
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
    """Index of the first point of each voxel without stray points, and the number of points in the voxel."""
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
    block = group_numbers(_keys([x[first] // _BLOCK for x in cell])).ravel()
    around = np.bincount(block, count)[block]
    dense = np.argsort(around)
    surface = around[dense[np.searchsorted(np.cumsum(count[dense]), _SURFACE_SHARE * count.sum())]]
    solid = around >= _STRAY_SHARE * surface
    usual = np.median(count[solid])
    if usual >= 4:
        solid &= count >= 0.25 * usual
    return kept[first[solid]], count[solid]


def _keys(cell: Sequence[IndexArray]) -> IndexArray:
    """One integer (N,) for each cell, from its three indices `cell` (3, N), counted from 0."""
    x, y, z = cell
    key = x * (int(y.max()) + 1)
    key += y
    key *= int(z.max()) + 1
    key += z
    return key


def _first_of_each(key: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Index of the first occurrence of each value of `key`, in ascending order of the values, and its count."""
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
    """Mask (N,): whether all three coordinates of points (N, 3) are finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.isfinite(points_mm @ np.ones(3))  # a sum is quicker than all(axis=1)


def points_within(points_mm: Array, centre_mm: Array, radius_mm: float) -> tuple[IndexArray, Array]:
    """Ascending indices of the points (N, 3) within a radius of a centre (3,), and their vectors (K, 3) from it.

    Points with coordinates that are not finite are left out.
    """
    parts = []
    ones = np.ones(3)
    most = radius_mm**2 - float(centre_mm @ centre_mm)
    for start in range(0, len(points_mm), _AT_A_TIME):
        some = points_mm[start : start + _AT_A_TIME]
        with np.errstate(invalid="ignore", over="ignore"):
            # |p|^2 - 2 p . c, as two products with matrices: a difference of rows takes five times as long.
            squared = (some * some) @ ones - some @ (2 * centre_mm)
            parts.append(np.flatnonzero(squared < most) + start)
    near = np.concatenate([*parts, np.zeros(0, dtype=np.int64)])
    return near, points_mm.take(near, axis=0) - centre_mm
