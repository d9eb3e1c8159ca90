"""A slow wander of what is measured: the covariance that it gives to points measured soon after each other.

    C = (1 - share) 1 + share K,   K_ij = exp(-|t_i - t_j| / time) within a setup,   0 between setups

on whitened rows, each axis by itself. The inverse of K between T moments is tridiagonal (Rybicki and Press 1995), so
that products with C^-1 cost no more than the number of points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded, solve_triangular

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.noise_shape import CorrelatedDrift


@dataclass(frozen=True)
class Moments:
    """When each of M points was measured: T moments in the order of setups and times."""

    of_point: IndexArray  # (M,)
    gap: Array  # (T,) s, or poses, since the moment before; inf where a setup begins
    in_poses: bool  # whether times are not known, and poses are counted

    @classmethod
    def of(cls, poses: Poses, row: IndexArray) -> Moments:
        """The moments of points measured at these rows (M,) of the poses."""
        time = poses.time_s
        known = time is not None and len(np.unique(time)) > 2
        at = np.arange(len(poses), dtype=float) if time is None or not known else time
        setup = np.unique(poses.setup, return_inverse=True)[1]
        keys, of_point = np.unique(np.column_stack([setup, at])[row], axis=0, return_inverse=True)
        same = np.diff(keys[:, 0]) == 0
        gap = np.concatenate([[np.inf], np.where(same, np.diff(keys[:, 1]), np.inf)])
        return cls(of_point.reshape(-1), gap, not known)

    def select(self, keep: IndexArray) -> Moments:
        """The same for some of the points; the moments stay."""
        return Moments(self.of_point[keep], self.gap, self.in_poses)

    def products(self, wanders: Sequence[CorrelatedDrift], rows: Array) -> Iterator[tuple[Array, float]]:
        """For each wander rows^T C^-1 rows, summed over the axes, of rows (M, 3, K): (K, K); and log det C of one axis.

        By Woodbury's identity with the wander at each moment as the unknown.
        """
        order = self.order
        count = np.bincount(self.of_point, minlength=len(self.gap)).astype(float)
        seen = np.flatnonzero(count)
        starts = np.searchsorted(self.of_point[order], seen)
        summed = np.zeros((len(count), 3 * rows.shape[2]))
        summed[seen] = np.add.reduceat(rows[order].reshape(len(rows), -1), starts, axis=0)
        plain = _product(rows)
        for wander in wanders:
            white, share = 1.0 - wander.share, wander.share
            kept = np.exp(-self.gap / wander.time)
            free = np.maximum(1.0 - kept**2, 1e-9)
            diagonal = 1.0 / free
            diagonal[:-1] += (kept**2 / free)[1:]
            upper = cholesky_banded(np.stack([-kept / free / share, diagonal / share + count / white]))
            lower = np.stack([upper[1], np.append(upper[0, 1:], 0.0)])
            inner = solve_banded((1, 0), lower, summed, check_finite=False)
            log_det = len(rows) * np.log(white) + len(count) * np.log(share) + float(np.sum(np.log(free)))
            found = plain / white - _product(inner.reshape(len(count), 3, -1)) / white**2
            yield found, float(log_det + 2.0 * np.sum(np.log(upper[1])))

    def decorrelator(self, wander: CorrelatedDrift) -> Array:
        """(M, M) lower triangular L with C = L L^T, in the order of `order`."""
        starts = np.isinf(self.gap)
        part = np.cumsum(starts)
        at = np.cumsum(np.where(starts, 0.0, self.gap))
        of_point = self.of_point[self.order]
        apart = np.abs(at[of_point][:, None] - at[of_point])
        kernel = np.where(part[of_point][:, None] == part[of_point], np.exp(-apart / wander.time), 0.0)
        covariance = wander.share * kernel + (1.0 - wander.share) * np.eye(len(of_point))
        return np.asarray(np.linalg.cholesky(covariance), np.float64)

    @property
    def order(self) -> IndexArray:
        """(M,) points in the order in which they were measured."""
        return np.argsort(self.of_point, kind="stable")


def decorrelated(rows: Array, root: Array, order: IndexArray) -> Array:
    """Rows (M, 3, K) without what the points before tell of them, so that each is new: L^-1 in the order of measuring.

    root, order: of `Moments`.
    """
    out = np.empty_like(rows)
    in_order = rows[order].reshape(len(rows), -1)
    out[order] = solve_triangular(root, in_order, lower=True, check_finite=False).reshape(rows.shape)
    return out


def _product(rows: Array) -> Array:
    """(K, K) of (M, 3, K)."""
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
