"""Optimality of a set of poses as linear algebra: unknowns, information, and the target combinations.

A candidate's rows are the derivative of its measured numbers by the unknowns, in units of their noise. The information
(inverse covariance) with some poses measured is H = prior information + sum of rows^T rows over these poses. A question
prefers poses with a small measure of the covariance C = H^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError

VARIANCE, VOLUME = "variance", "volume"


@dataclass(frozen=True)
class OptimalityCriterion:
    """Optimality question: target combinations of K unknowns, prior information, and rows of N candidate poses.

    With W the target combinations, `measure` "variance" is trace(W^T C W), the sum of their variances: I-optimal where
    W are the rows of a region's points, A-optimal for single coefficients. "volume" is det(W^T C W)^(1/m): D-optimal.
    """

    rows: Array  # (N, r, K)
    prior_information: Array  # (K, K), positive definite
    target_combinations: Array  # (K, m)
    measure: str = VARIANCE

    def __post_init__(self) -> None:
        n = self.prior_information.shape[0]
        shapes = self.prior_information.shape, self.rows.shape[2], self.target_combinations.shape[0]
        assert shapes == ((n, n), n, n)
        assert self.measure in (VARIANCE, VOLUME)

    def log_value(self, information: Array) -> float:
        """Log of the question's measure (target variance or volume) for an information matrix (K, K)."""
        covariance = inverse(information)
        target_covariance = self.target_combinations.T @ covariance @ self.target_combinations
        if self.measure == VARIANCE:
            return float(np.log(np.trace(target_covariance)))
        return float(np.linalg.slogdet(target_covariance)[1]) / target_covariance.shape[0]

    def log_values_with(self, information: Array) -> Array:
        """Log of the question's measure (N,) with each one of N candidates added to an information matrix.

        By Woodbury: C' = C - C R^T (1 + R C R^T)^-1 R C, an r x r system for each candidate.
        """
        covariance = inverse(information)
        n, r, k = self.rows.shape
        flat = self.rows.reshape(n * r, k)
        spread = np.matmul((flat @ covariance).reshape(n, r, k), np.swapaxes(self.rows, 1, 2))
        spread = spread + np.eye(r)
        cross_covariance = covariance @ self.target_combinations  # (K, m)
        target_covariance = self.target_combinations.T @ cross_covariance
        if self.measure == VARIANCE:
            squares = _squares(flat, cross_covariance, self.rows)
            drop = np.trace(np.linalg.solve(spread, squares), axis1=1, axis2=2)
            least = 1e-12 * np.trace(target_covariance)  # rounding
            return np.log(np.maximum(np.trace(target_covariance) - drop, least))
        m = target_covariance.shape[0]
        before = float(np.linalg.slogdet(target_covariance)[1])
        root = np.linalg.inv(np.linalg.cholesky(target_covariance))
        squares = _squares(flat, cross_covariance @ root.T, self.rows)
        after = np.linalg.slogdet(spread - squares)[1] - np.linalg.slogdet(spread)[1]
        return (before + after) / m


def condensed(combinations: Array) -> Array:
    """At most K combinations that have the same total variance as the given combinations (K, m)."""
    k, m = combinations.shape
    return combinations if m <= k else np.asarray(np.linalg.qr(combinations.T, mode="r")).T


def inverse(information: Array) -> Array:
    """Covariance (K, K) from an information matrix (K, K). Raises CalibError where that is not positive definite."""
    # In units in which the diagonal is 1: unknown frames and known lengths are many powers of ten apart.
    size = np.sqrt(np.diag(information))
    try:
        root = np.linalg.inv(np.linalg.cholesky(information / np.outer(size, size)))
    except np.linalg.LinAlgError:
        raise CalibError(
            "what is known before planning bounds no unknown in some direction; plan with the prior"
        ) from None
    return (root.T @ root) / np.outer(size, size)


def _squares(flat: Array, factor: Array, rows: Array) -> Array:
    """Products R B B^T R^T (N, r, r) of each candidate's rows R (r, K) and a factor B (K, m).

    `flat` has all rows (N r, K).
    """
    n, r, k = rows.shape
    if factor.shape[1] < k:
        products = (flat @ factor).reshape(n, r, -1)
        return products @ np.swapaxes(products, 1, 2)
    return (flat @ (factor @ factor.T)).reshape(n, r, k) @ np.swapaxes(rows, 1, 2)
