"""What the poses of a plan are to tell, as linear algebra: unknowns, what each candidate tells, and what matters of it.

A candidate's rows are the derivative of its measured numbers by the unknowns, in units of their noise. Measured poses
add up: the information (inverse covariance) of a plan is H = known + sum of rows^T rows. A question is answered the
better the smaller its measure of the covariance C = H^-1 is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError

VARIANCE, VOLUME = "variance", "volume"


@dataclass(frozen=True)
class Question:
    """What is known of K unknowns, what each of N candidates tells of them, and which m sums of them matter.

    `measure`: "variance" is trace(W^T C W), the sum of the wanted sums' variances: I-optimal where W are the rows of a
    region's points, A-optimal for single coefficients. "volume" is det(W^T C W)^(1/m): D-optimal.
    """

    rows: Array  # (N, r, K)
    known: Array  # (K, K), positive definite
    wanted: Array  # (K, m)
    measure: str = VARIANCE

    def __post_init__(self) -> None:
        n = self.known.shape[0]
        assert (self.known.shape, self.rows.shape[2], self.wanted.shape[0]) == ((n, n), n, n)
        assert self.measure in (VARIANCE, VOLUME)

    def log_value(self, information: Array) -> float:
        """The log of the measure, for an information (K, K)."""
        covariance = inverse(information)
        inside = self.wanted.T @ covariance @ self.wanted
        if self.measure == VARIANCE:
            return float(np.log(np.trace(inside)))
        return float(np.linalg.slogdet(inside)[1]) / inside.shape[0]

    def log_values_with(self, information: Array) -> Array:
        """(N,) the log of the measure with one candidate more, for each.

        By Woodbury: C' = C - C R^T (1 + R C R^T)^-1 R C, an r x r system a candidate.
        """
        covariance = inverse(information)
        n, r, k = self.rows.shape
        flat = self.rows.reshape(n * r, k)
        spread = np.matmul((flat @ covariance).reshape(n, r, k), np.swapaxes(self.rows, 1, 2))
        spread = spread + np.eye(r)
        told = covariance @ self.wanted  # (K, m)
        inside = self.wanted.T @ told
        if self.measure == VARIANCE:
            seen = _squares(flat, told, self.rows)
            drop = np.trace(np.linalg.solve(spread, seen), axis1=1, axis2=2)
            least = 1e-12 * np.trace(inside)  # rounding
            return np.asarray(np.log(np.maximum(np.trace(inside) - drop, least)))
        m = inside.shape[0]
        before = float(np.linalg.slogdet(inside)[1])
        root = np.linalg.inv(np.linalg.cholesky(inside))
        seen = _squares(flat, told @ root.T, self.rows)
        after = np.linalg.slogdet(spread - seen)[1] - np.linalg.slogdet(spread)[1]
        return np.asarray((before + after) / m)


def condensed(wanted: Array) -> Array:
    """At most K sums with the same variances in total, of wanted (K, m) with m > K: W W^T stays what it is."""
    k, m = wanted.shape
    return wanted if m <= k else np.asarray(np.linalg.qr(wanted.T, mode="r")).T


def inverse(information: Array) -> Array:
    """The covariance (K, K) of an information. Raises CalibError where it is not positive definite."""
    # In units in which the diagonal is 1: unknown frames and known lengths are many powers of ten apart.
    size = np.sqrt(np.diag(information))
    try:
        root = np.linalg.inv(np.linalg.cholesky(information / np.outer(size, size)))
    except np.linalg.LinAlgError:
        raise CalibError(
            "what is known before planning bounds no unknown in some direction; plan with the prior"
        ) from None
    return np.asarray((root.T @ root) / np.outer(size, size))


def _squares(flat: Array, told: Array, rows: Array) -> Array:
    """(N, r, r) R B B^T R^T of each candidate's rows, B = told (K, m)."""
    n, r, k = rows.shape
    if told.shape[1] < k:
        seen = (flat @ told).reshape(n, r, -1)
        return np.asarray(seen @ np.swapaxes(seen, 1, 2))
    return np.asarray((flat @ (told @ told.T)).reshape(n, r, k) @ np.swapaxes(rows, 1, 2))
