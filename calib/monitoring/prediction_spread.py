"""The covariance of new residuals under an earlier fit: noise at each point, and what all points share of the fit.

Of M points it is 3 M by 3 M, but what they share are the earlier fit's parameters and the scanner's frame, a few dozen
numbers. So it is kept as noise^2 (1 - Q Q^T) + U diag(s^2) U^T, with U and Q of a few dozen columns: memory grows with
the points, not with their square, and its inverse root exists however small the noise is beside s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.uncertainty import covariance_root

_ROUNDING = 1e-12  # share of a column's size: what is below is rounding, no direction


@dataclass(frozen=True)
class Spread:
    """Covariance of whitened residuals (3 M,), which are asked nothing along `blind`."""

    noise: float
    axes: Array  # (3 M, K) U, orthonormal
    sizes: Array  # (K,) s
    blind: Array  # (3 M, L) Q, orthonormal: what a free scanner frame takes up

    @classmethod
    def of(cls, columns: Array, covariance: Array, noise: float, blind: Array | None = None) -> Spread:
        """The spread by unknowns of covariance (P, P) and columns (3 M, P), and by noise of a size in each row."""
        blind = np.zeros((len(columns), 0)) if blind is None else np.linalg.svd(blind, full_matrices=False)[0]
        shared = columns @ covariance_root(covariance)
        length = np.linalg.norm(shared)
        shared = _without(shared, blind)
        axes, sizes, _ = np.linalg.svd(shared, full_matrices=False)
        counts = sizes > max(_ROUNDING * length, 1e-6 * noise)  # what is far below the noise does not show
        return cls(noise, _without(axes[:, counts], blind), sizes[counts], blind)

    @property
    def rows(self) -> int:
        """How many independent residuals there are."""
        return len(self.axes) - self.blind.shape[1]

    def whiten(self, values: Array) -> Array:
        """(3 M, ...) values times the inverse root, so that residuals have unit covariance."""
        values = _without(values, self.blind)
        along = self.axes.T @ values
        shrink = 1.0 - self.noise / np.hypot(self.noise, self.sizes)
        return np.asarray(values - self.axes @ (shrink.reshape(-1, *[1] * (along.ndim - 1)) * along)) / self.noise

    def total_weight(self, blocks: Array) -> float:
        """The squared Frobenius norm of the inverse root times the block diagonal matrix of blocks (M, 3, 3)."""
        share = self.sizes / np.hypot(self.noise, self.sizes)
        taken = np.concatenate([self.blind, share * self.axes], axis=1).reshape(len(blocks), 3, -1)
        seen = np.einsum("mij,mik->mjk", blocks, taken)
        return float(max(np.sum(blocks**2) - np.sum(seen**2), 0.0)) / self.noise**2

    def coloured(self, colour: Array) -> ErrorCovariance:
        """The covariance of errors that are colour (M, 3, 3) times these residuals, each point's."""

        def turned(columns: Array) -> Array:
            seen = np.einsum("mij,mjk->mik", colour, columns.reshape(len(colour), 3, -1))
            return seen.reshape(columns.shape)

        own_mm2 = self.noise**2 * colour @ np.swapaxes(colour, 1, 2)
        return ErrorCovariance(own_mm2, turned(self.sizes * self.axes), turned(self.noise * self.blind))


@dataclass(frozen=True)
class ErrorCovariance(Brief):
    """Covariance of M errors (3 M, 3 M): own on the diagonal, plus shared shared^T, less taken taken^T."""

    own_mm2: Array  # (M, 3, 3)
    shared_mm: Array  # (3 M, K)
    taken_mm: Array  # (3 M, L)

    @property
    def trace_mm2(self) -> float:
        """The sum of all variances."""
        own = float(np.trace(self.own_mm2, axis1=1, axis2=2).sum())
        return own + float(np.sum(self.shared_mm**2)) - float(np.sum(self.taken_mm**2))

    @property
    def sum_of_squares_mm4(self) -> float:
        """Sum of the squares of all entries, which is that of the squared eigenvalues."""

        def beside_own(columns: Array) -> float:
            seen = columns.reshape(len(self.own_mm2), 3, -1)
            return float(np.einsum("mik,mij,mjk->", seen, self.own_mm2, seen, optimize=True))

        def squared(first: Array, second: Array) -> float:
            return float(np.sum((first.T @ second) ** 2))

        shared, taken = self.shared_mm, self.taken_mm
        alone = float(np.sum(self.own_mm2**2)) + squared(shared, shared) + squared(taken, taken)
        return alone + 2.0 * (beside_own(shared) - beside_own(taken) - squared(shared, taken))

    def dense(self) -> Array:
        """(3 M, 3 M) mm^2: for a few points."""
        size = self.own_mm2.shape[0]
        out = np.zeros((size, 3, size, 3))
        out[np.arange(size), :, np.arange(size)] = self.own_mm2
        flat = out.reshape(3 * size, 3 * size)
        return flat + self.shared_mm @ self.shared_mm.T - self.taken_mm @ self.taken_mm.T


def _without(values: Array, basis: Array) -> Array:
    """Values (R, ...) less what orthonormal columns (R, L) say of them."""
    return np.asarray(values - basis @ (basis.T @ values))
