"""Sizes and spreads of numbers, of vectors and of covariances."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, IndexArray

MAD_TO_SIGMA = 1.4826  # of normal numbers: sigma over the median of their absolute deviations


def mad_sigma(deviations: Array) -> float:
    """Sigma of normal numbers, robust to outliers, from their deviations from the middle: 1.4826 MAD."""
    return float(MAD_TO_SIGMA * np.median(np.abs(deviations)))


def mad_sigmas(values: Array) -> Array:
    """Robust sigma (n,) of each column of values (N, n) about its median: 1.4826 MAD."""
    return MAD_TO_SIGMA * np.median(np.abs(values - np.median(values, axis=0)), axis=0)


def rms(values: ArrayLike) -> float:
    """Root mean square of numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_length(vectors: Array) -> float:
    """Root mean square of the lengths of vectors (N, d)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def axis_variances(covariances: Array) -> Array:
    """Variances (N,) along one axis, in the mean over all three, of errors with these covariances (N, 3, 3)."""
    return np.trace(covariances, axis1=1, axis2=2) / 3.0


def axis_sigma(covariances: Array) -> float:
    """Sigma along one axis of errors in space with these covariances (N, 3, 3), root mean square."""
    return float(np.sqrt(np.mean(np.trace(covariances, axis1=1, axis2=2)) / 3.0))


def group_numbers(keys: ArrayLike) -> IndexArray:
    """Number (N,) of each value's group, of values (N,) or rows (N, K); equal ones are a group, the least the first."""
    keys = np.asarray(keys)
    return np.unique(keys, axis=0 if keys.ndim > 1 else None, return_inverse=True)[1].reshape(-1)


def group_sums(values: Array, group: IndexArray, groups: int) -> Array:
    """Sums (G, ...) over each group of values (M, ...), zero where a group has none; `group` (M,) numbers them."""
    total = np.zeros((groups, *values.shape[1:]))
    np.add.at(total, group, values)
    return total


def group_means(values: Array, group: IndexArray, groups: int, *, empty: float = 0.0) -> Array:
    """Means (G, ...) over each group of values (M, ...), `empty` where a group has none; `group` (M,) numbers them."""
    count = np.bincount(group, minlength=groups).reshape(-1, *[1] * (values.ndim - 1))
    return np.where(count > 0, group_sums(values, group, groups) / np.maximum(count, 1), empty)


def ranks(values: Array, same: float) -> IndexArray:
    """Ranks (N,) of values; neighbours in size that differ by no more than `same` have equal rank."""
    order = np.argsort(values, kind="stable")
    out = np.empty(len(values), dtype=np.int64)
    out[order] = np.concatenate([[0], np.cumsum(np.diff(values[order]) > same)])
    return out


def left_out_by(hat: Array) -> Array:
    """Matrices 1 - H (..., n, n) whose inverses turn residuals of rows into their errors where a fit leaves them out.

    H is the rows' block of the hat matrix. Rows that alone determine a direction make 1 - H singular; a floor keeps
    their error finite.
    """
    return (1.0 + 1e-9) * np.eye(hat.shape[-1]) - hat


def covariance_root(covariance: Array) -> Array:
    """Root R (P, P) of a covariance R R^T, in any units; negative eigenvalues from rounding count as zero."""
    scale = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    size, turn = np.linalg.eigh(inverse[:, None] * covariance * inverse)
    return scale[:, None] * turn * np.sqrt(np.clip(size, 0.0, None))
