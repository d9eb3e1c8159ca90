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
        # The quicker driver of numpy may not converge where sizes span many powers of ten.
        found = svd(_without(shared, blind), full_matrices=False, lapack_driver="gesvd")
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
        shrink = self.axes * (1.0 - self.noise / np.hypot(self.noise, self.sizes))
        return np.asarray(values - shrink @ (self.axes.T @ values)) / self.noise

    def total_weight(self, blocks: Array) -> float:
        """Squared Frobenius norm of the covariance's inverse root times a block diagonal matrix (M, 3, 3)."""
        share = self.sizes / np.hypot(self.noise, self.sizes)
        taken = np.concatenate([self.blind, share * self.axes], axis=1).reshape(len(blocks), 3, -1)
        removed = np.einsum("mij,mik->mjk", blocks, taken)
        return float(max(np.sum(blocks**2) - np.sum(removed**2), 0.0)) / self.noise**2

    def shared_mm(self, colour: Array) -> float:
        """RMS of the part of the points' 3D errors, mm, that the fit's errors make.

        colour  # (M, 3, 3) from residuals to errors of the points, mm
        """
        shared = colour @ (self.sizes * self.axes).reshape(len(colour), 3, -1)
        return float(np.sqrt(np.sum(shared**2) / len(colour)))

    def limit_mm(self, colour: Array) -> float:
        """Limit below which the RMS of the points' 3D errors stays in 99.73 % of unchanged cells, mm.

        Its square is a weighted sum of chi-square variables, approximated by one of the same mean and variance
        (Satterthwaite 1946). The errors' covariance is D + C S C^T, D block diagonal and S of signs.

        colour  # (M, 3, 3) from residuals to errors of the points, mm
        """
        own = self.noise**2 * colour @ np.swapaxes(colour, 1, 2)
        sign = np.repeat([1.0, -1.0], [len(self.sizes), self.blind.shape[1]])
        axes = np.concatenate([self.sizes * self.axes, self.noise * self.blind], axis=1)
        columns = colour @ axes.reshape(len(colour), 3, -1)
        gram = np.einsum("mik,mil->kl", columns, columns, optimize=True)
        mean = float(np.trace(own, axis1=1, axis2=2).sum() + sign @ np.diag(gram))
        of_own = np.sum(columns * (own @ columns), axis=(0, 1))
        squares = float(np.sum(own**2) + 2.0 * sign @ of_own + sign @ gram**2 @ sign)
        highest = squares / mean * chi2_ppf(LIMIT_SHARE, mean**2 / squares)
        return float(np.sqrt(highest / len(colour)))


def _without(values: Array, basis: Array) -> Array:
    """Values (R, ...) with the span of orthonormal columns (R, L) projected out."""
    return values - basis @ (basis.T @ values)
