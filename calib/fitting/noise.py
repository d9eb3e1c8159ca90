"""Noise of points under a known noise shape: covariances, correlation in time, Student's t tails.

Tails: a point's three coordinates are normal with a variance of their own, so that a whitened residual e has weight

    w = (nu + 3) / (nu + |e|^2 / s^2),   s^2 the mean of w |e|^2 / 3

(Lange, Little and Taylor 1989). Weights are scaled so that the residual keeps its size.

Correlated drift: on whitened rows, each axis by itself, the covariance is

    C = (1 - share) 1 + share K,   K_ij = exp(-|t_i - t_j| / time) within a setup,   0 between setups.

The inverse of K between T moments is tridiagonal (Rybicki and Press 1995), so that products with C^-1 cost no more than
the number of points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky_banded, solve_banded, solve_triangular

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.noise_shape import CorrelatedDrift, NoiseShape
from calib.statistics import group_numbers

_ROUNDS = 30


def student_scale(square: Array, tail: float, size: int = 3) -> float:
    """Maximum-likelihood scale s^2 of Student's t, from squared lengths (M,) of vectors of `size` coordinates."""
    scale = max(float(np.median(square)) / size, 1e-300)
    for _ in range(_ROUNDS):
        scale = max(float(np.mean((tail + size) / (tail + square / scale) * square)) / size, 1e-300)
    return scale


def student_weights(square: Array, tail: float) -> Array:
    """Weights (M,) of points, above 0, for Student's t noise, from the squared lengths (M,) of their residuals.

    Scaled so that the weighted mean square is that of the residual itself, or that of the distribution,
    nu / (nu - 2) s^2, where a few far points make the residual's larger.
    """
    scale = student_scale(square, tail)
    weights = (tail + 3.0) / (tail + square / scale)
    size = min(float(np.mean(square)) / 3.0, tail / (tail - 2.0) * scale)
    return weights * (size / scale)


def noise_factors(shape: NoiseShape, xyz_mm: Array) -> Array:
    """Factors (M, 3, 3) that multiply the declared noise of points (M, 3) in the scanner frame."""
    size, sight = _size_and_sight(shape, xyz_mm)
    along = np.eye(3) + (shape.depth - 1.0) * sight[:, :, None] * sight[:, None, :]
    return size[:, None, None] * (np.array(shape.axes) @ along)


def inverse_factors(shape: NoiseShape, xyz_mm: Array) -> tuple[Array, float]:
    """Inverses (M, 3, 3) of `noise_factors`, and the sum of the log determinants of the factors."""
    size, sight = _size_and_sight(shape, xyz_mm)
    along = np.eye(3) + (1.0 / shape.depth - 1.0) * sight[:, :, None] * sight[:, None, :]
    axes = np.array(shape.axes)
    log_axes = float(np.log(abs(np.linalg.det(axes)) * abs(shape.depth)))
    inverse = (along @ np.linalg.inv(axes)) / size[:, None, None]
    return np.asarray(inverse), float(3.0 * np.sum(np.log(size))) + len(size) * log_axes


def _size_and_sight(shape: NoiseShape, xyz_mm: Array) -> tuple[Array, Array]:
    distance_mm = np.linalg.norm(xyz_mm, axis=1)
    size = shape.scale * np.exp(shape.growth_per_m * 1e-3 * (distance_mm - shape.distance_mm))
    return size, xyz_mm / np.maximum(distance_mm, 1e-9)[:, None]


def shaped_covariance(factors: Array, covariance_mm2: Array) -> Array:
    """Covariances (M, 3, 3), mm^2: declared ones multiplied by `noise_factors` (M, 3, 3) from both sides."""
    return factors @ covariance_mm2 @ np.swapaxes(factors, 1, 2)


@dataclass(frozen=True)
class Moments:
    """Times at which M points were measured: T distinct times, ordered by setup and time."""

    of_point: IndexArray  # (M,)
    gap: Array  # (T,) s, or poses, since the moment before; inf where a setup begins
    in_poses: bool  # whether times are not known, and poses are counted

    @classmethod
    def of(cls, poses: Poses, row: IndexArray) -> Moments:
        """Times of measurement of points, each given by the row (M,) of its pose."""
        time = poses.time_s
        known = time is not None and len(np.unique(time)) > 2
        at = np.arange(len(poses), dtype=float) if time is None or not known else time
        setup = group_numbers(poses.setup)
        keys, of_point = np.unique(np.column_stack([setup, at])[row], axis=0, return_inverse=True)
        same = np.diff(keys[:, 0]) == 0
        gap = np.concatenate([[np.inf], np.where(same, np.diff(keys[:, 1]), np.inf)])
        return cls(of_point.reshape(-1), gap, not known)

    def select(self, keep: IndexArray) -> Moments:
        """Times of measurement of some of the points; all T distinct times are kept."""
        return Moments(self.of_point[keep], self.gap, self.in_poses)

    def products(self, drifts: Sequence[CorrelatedDrift], rows: Array) -> Iterator[tuple[Array, float]]:
        """For each of some drifts: product rows^T C^-1 rows (K, K) of rows (M, A, K) of A axes, and log det C of one.

        Computed by Woodbury's identity with the drift at each moment as the unknown.
        """
        order = self.order
        count = np.bincount(self.of_point, minlength=len(self.gap)).astype(float)
        seen = np.flatnonzero(count)
        starts = np.searchsorted(self.of_point[order], seen)
        summed = np.zeros((len(count), rows.shape[1] * rows.shape[2]))
        summed[seen] = np.add.reduceat(rows[order].reshape(len(rows), -1), starts, axis=0)
        plain = _product(rows)
        for drift in drifts:
            white, share = 1.0 - drift.share, drift.share
            kept = np.exp(-self.gap / drift.time)
            free = np.maximum(1.0 - kept**2, 1e-9)
            diagonal = 1.0 / free
            diagonal[:-1] += (kept**2 / free)[1:]
            upper = cholesky_banded(np.stack([-kept / free / share, diagonal / share + count / white]))
            lower = np.stack([upper[1], np.append(upper[0, 1:], 0.0)])
            inner = solve_banded((1, 0), lower, summed, check_finite=False)
            log_det = len(rows) * np.log(white) + len(count) * np.log(share) + float(np.sum(np.log(free)))
            found = plain / white - _product(inner.reshape(len(count), rows.shape[1], -1)) / white**2
            yield found, float(log_det + 2.0 * np.sum(np.log(upper[1])))

    def decorrelator(self, drift: CorrelatedDrift) -> Array:
        """Lower triangular root L (M, M) of the drift's correlation C = L L^T of points in order of measurement."""
        starts = np.isinf(self.gap)
        part = np.cumsum(starts)
        at = np.cumsum(np.where(starts, 0.0, self.gap))
        of_point = self.of_point[self.order]
        apart = np.abs(at[of_point][:, None] - at[of_point])
        kernel = np.where(part[of_point][:, None] == part[of_point], np.exp(-apart / drift.time), 0.0)
        covariance = drift.share * kernel + (1.0 - drift.share) * np.eye(len(of_point))
        return np.asarray(np.linalg.cholesky(covariance), np.float64)

    @property
    def order(self) -> IndexArray:
        """Indices (M,) of the points in the order of measurement."""
        return np.argsort(self.of_point, kind="stable")


def decorrelated(rows: Array, root: Array, order: IndexArray) -> Array:
    """Rows (M, 3, K) of points with the drift's correlation in time removed (multiplied by L^-1).

    root, order: `Moments.decorrelator` and `Moments.order`.
    """
    out = np.empty_like(rows)
    in_order = rows[order].reshape(len(rows), -1)
    out[order] = solve_triangular(root, in_order, lower=True, check_finite=False).reshape(rows.shape)
    return out


def _product(rows: Array) -> Array:
    """Sum rows^T rows (K, K) over points and axes of rows (M, 3, K)."""
    flat = rows.reshape(-1, rows.shape[2])
    return flat.T @ flat


@dataclass(frozen=True)
class Whitening:
    """Linear map that whitens the residual of M points for correlated drift and Student's t tails."""

    order: IndexArray  # (M,) in which the points were measured
    root: Array | None  # (M, M) lower triangular, of `Moments.decorrelator`; None without correlation
    weights: Array | None = None  # (M,) under heavy tails
    tail: float | None = None  # degrees of freedom of these

    @classmethod
    def of(cls, shape: NoiseShape, poses: Poses, row: IndexArray, residual: Array) -> Whitening | None:
        """Whitening for a noise shape, from the points' poses and residual (3 M,); None without drift and tails."""
        if shape.wander is None and shape.tail is None:
            return None
        moments = Moments.of(poses, row)
        root = None if shape.wander is None else moments.decorrelator(shape.wander)
        plain = cls(moments.order, root)
        if shape.tail is None:
            return plain
        square = np.sum(plain.apply(residual[:, None]).reshape(-1, 3) ** 2, axis=1)
        return cls(moments.order, root, student_weights(square, shape.tail), shape.tail)

    def apply(self, columns: Array) -> Array:
        """Fully whitened columns (R, K), from columns (R, K) that were whitened for each point's covariance."""
        rows = columns.reshape(len(columns) // 3, 3, columns.shape[1])
        if self.root is not None:
            rows = decorrelated(rows, self.root, self.order)
        if self.weights is not None:
            rows = rows * np.sqrt(self.weights)[:, None, None]
        return np.asarray(rows.reshape(columns.shape))

    def unweighted(self, residual: Array) -> Array:
        """Whitened residual (3 M,) without the weights for Student's t tails."""
        if self.weights is None:
            return residual
        return np.asarray((residual.reshape(-1, 3) / np.sqrt(self.weights)[:, None]).ravel())

    def with_tails(self, normal: Array, rng: np.random.Generator) -> Array:
        """Noise (3 M, D) with Student's t tails, made from normal noise.

        The normal noise of each point is divided by the root of its own chi^2 over nu.
        """
        if self.tail is None:
            return normal
        rows = normal.reshape(-1, 3, normal.shape[1])
        divided = np.sqrt(rng.chisquare(self.tail, (len(rows), normal.shape[1])) / self.tail)
        return np.asarray((rows / divided[:, None, :]).reshape(normal.shape))
