"""Covariance of new residuals given an earlier fit: noise of each point, and the fit's errors shared by all.

For M points the matrix is 3 M by 3 M, but the shared errors are those of the fit's parameters and of the scanner's
frame, a few dozen numbers. It is kept as noise^2 (1 - Q Q^T) + U diag(s^2) U^T, with U and Q of a few dozen columns:
memory grows with the points, not with their square, and the inverse root exists however small the noise is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import svd

from calib.array_types import Array
from calib.brief import Brief
from calib.statistics import chi2_ppf, covariance_root

LIMIT_SHARE = 0.9973  # share of unchanged cells that stay below the limit: three sigmas of a control chart
_ROUNDING = 1e-12  # share of the largest size, below which a direction is rounding


@dataclass(frozen=True)
class Spread:
    """Covariance of whitened residuals (3 M,), without the directions that a free scanner frame fits.

    The residuals are in units of their declared noise.
    """

    noise: float  # over the declared one
    axes: Array  # (3 M, K) U, orthonormal
    sizes: Array  # (K,) s
    blind: Array  # (3 M, L) Q, orthonormal: directions that a free scanner frame fits

    @classmethod
    def of(cls, columns: Array, covariance: Array, noise: float, blind: Array | None = None) -> Spread:
        """Covariance of residuals from the noise, and from unknowns with covariance (P, P) and derivatives (3 M, P)."""
        blind = np.zeros((len(columns), 0)) if blind is None else np.linalg.svd(blind, full_matrices=False)[0]
        shared = columns @ covariance_root(covariance)
        length = np.linalg.norm(shared)
        shared = _without(shared, blind)
        # The quicker driver of numpy may not converge where sizes span many powers of ten.
        found = svd(shared, full_matrices=False, lapack_driver="gesvd")
        axes, sizes = (np.asarray(part, dtype=float) for part in found[:2])
        counts = sizes > max(_ROUNDING * length, 1e-6 * noise)  # far below the noise nothing shows
        return cls(noise, _without(axes[:, counts], blind), sizes[counts], blind)

    @property
    def rows(self) -> int:
        """Number of independent residuals."""
        return len(self.axes) - self.blind.shape[1]

    def whiten(self, values: Array) -> Array:
        """Residuals or derivatives (3 M, ...) multiplied by the inverse root of the covariance."""
        values = _without(values, self.blind)
        along = self.axes.T @ values
        shrink = 1.0 - self.noise / np.hypot(self.noise, self.sizes)
        return np.asarray(values - self.axes @ (shrink.reshape(-1, *[1] * (along.ndim - 1)) * along)) / self.noise

    def total_weight(self, blocks: Array) -> float:
        """Squared Frobenius norm of the covariance's inverse root times a block diagonal matrix (M, 3, 3)."""
        share = self.sizes / np.hypot(self.noise, self.sizes)
        taken = np.concatenate([self.blind, share * self.axes], axis=1).reshape(len(blocks), 3, -1)
        removed = np.einsum("mij,mik->mjk", blocks, taken)
        return float(max(np.sum(blocks**2) - np.sum(removed**2), 0.0)) / self.noise**2

    def coloured(self, colour: Array) -> ErrorCovariance:
        """Covariance of the points' errors, mm, from the covariance of their residuals."""

        def in_mm(columns: Array) -> Array:
            return np.einsum("mij,mjk->mik", colour, columns.reshape(len(colour), 3, -1)).reshape(columns.shape)

        own_mm2 = self.noise**2 * colour @ np.swapaxes(colour, 1, 2)
        return ErrorCovariance(own_mm2, in_mm(self.sizes * self.axes), in_mm(self.noise * self.blind))


@dataclass(frozen=True)
class ErrorCovariance(Brief):
    """Covariance (3 M, 3 M) of the errors of M points, stored as block diagonal and low-rank terms.

    It is diag(own) + shared shared^T - taken taken^T.
    """

    own_mm2: Array  # (M, 3, 3)
    shared_mm: Array  # (3 M, K)
    taken_mm: Array  # (3 M, L)

    @property
    def trace_mm2(self) -> float:
        """Sum of all variances, mm^2."""
        own = float(np.trace(self.own_mm2, axis1=1, axis2=2).sum())
        return own + float(np.sum(self.shared_mm**2)) - float(np.sum(self.taken_mm**2))

    @property
    def sum_of_squares_mm4(self) -> float:
        """Sum of the squares of all entries, mm^4, equal to the sum of squared eigenvalues."""

        def with_own(columns: Array) -> float:
            blocks = columns.reshape(len(self.own_mm2), 3, -1)
            return float(np.einsum("mik,mij,mjk->", blocks, self.own_mm2, blocks, optimize=True))

        def squared(first: Array, second: Array) -> float:
            return float(np.sum((first.T @ second) ** 2))

        shared, taken = self.shared_mm, self.taken_mm
        alone = float(np.sum(self.own_mm2**2)) + squared(shared, shared) + squared(taken, taken)
        return alone + 2.0 * (with_own(shared) - with_own(taken) - squared(shared, taken))

    @property
    def limits_mm(self) -> tuple[float, float]:
        """Expected RMS of the 3D errors, and the limit below which it stays in 99.73 % of unchanged cells, mm.

        Its square is a weighted sum of chi-square variables, approximated by one of the same mean and variance
        (Satterthwaite 1946).
        """
        mean, squares, count = self.trace_mm2, self.sum_of_squares_mm4, len(self.own_mm2)
        highest = squares / mean * chi2_ppf(LIMIT_SHARE, mean**2 / squares)
        return float(np.sqrt(mean / count)), float(np.sqrt(highest / count))


def _without(values: Array, basis: Array) -> Array:
    """Values (R, ...) with the span of orthonormal columns (R, L) projected out."""
    return values - basis @ (basis.T @ values)
