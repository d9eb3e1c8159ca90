"""Sums and means over the points of each pose."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array, IndexArray


def sum_by_pose(values: Array, row: IndexArray, poses: int) -> Array:
    """The sum over each pose's points, (M, ...) -> (N, ...), zero where a pose has none.

    row  # (M,) which of the N poses each point belongs to
    """
    total = np.zeros((poses, *values.shape[1:]))
    np.add.at(total, row, values)
    return total


def mean_by_pose(values: Array, row: IndexArray, poses: int, *, empty: float = 0.0) -> Array:
    """The mean over each pose's points, (M, ...) -> (N, ...); `empty` where a pose has none. `row` as above."""
    count = points_by_pose(row, poses).reshape(-1, *[1] * (values.ndim - 1))
    mean = sum_by_pose(values, row, poses) / np.maximum(count, 1)
    return np.asarray(np.where(count > 0, mean, empty))


def points_by_pose(row: IndexArray, poses: int) -> IndexArray:
    """How many points each pose has, (M,) -> (N,)."""
    return np.bincount(row, minlength=poses)
