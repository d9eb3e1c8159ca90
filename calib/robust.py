"""Weights that let outliers speak softly. Off by default: what looks like an outlier is often physics.

Iteratively reweighted least squares: a point whose residual is r sigma away (in the metric of its covariance) counts
with Tukey's weight (1 - (r / c)^2)^2, which is zero beyond c. The scale is the median of all, so it does not need the
declared sigma to be right. A weight enters as a larger covariance, so frames and parameters see the same weights.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.distributions import chi_median
from calib.observations import Observations
from calib.residuals import Residuals
from calib.solver import Fit, solve

Array = NDArray[np.float64]

_TUKEY = 5.490  # 95 % efficient for normal errors in three dimensions (4.685 in one)
_LEAST = 1e-6  # a rejected point keeps this weight, so that a covariance stays finite
_ROUNDS = 20


def solve_robustly(
    make: Callable[[Observations], Residuals],
    observed: Observations,
    *,
    start: Array | None = None,
    prior: bool = True,
) -> tuple[Fit, Array]:
    """Fit with Tukey weights.

    Args:
        make: residuals from observations; one row a coordinate, point after point (positions).
        observed: the points with their covariances.
        start, prior: as of `solve`.

    Returns:
        The fit, whose noise and covariance count a down-weighted point as that much less, and the weights (M,).
    """
    residuals = make(observed)
    fit = solve(residuals, start=start, prior=prior)
    weights = np.ones(len(observed.points))
    for _ in range(_ROUNDS):
        norm = point_norms(residuals.residual(fit.x), len(weights)) / np.sqrt(weights)
        new = np.maximum(tukey_weights(norm), _LEAST)
        settled = bool(np.max(np.abs(new - weights)) < 1e-3)
        weights = new
        residuals = make(replace(observed, covariance_mm2=observed.covariance_mm2 / weights[:, None, None]))
        fit = solve(residuals, start=fit.x, prior=prior)
        if settled:
            break
    return fit, weights


def point_norms(residual: Array, points: int) -> Array:
    """(M,) length of each point's whitened residual."""
    return np.asarray(np.linalg.norm(residual.reshape(points, -1), axis=1))


def tukey_weights(norm: Array) -> Array:
    """(M,) weights of three-dimensional residuals of these lengths, scaled by their median."""
    scale = float(np.median(norm)) / chi_median(3)
    if scale <= 0.0:
        return np.ones_like(norm)
    return np.asarray(np.clip(1.0 - (norm / (_TUKEY * scale)) ** 2, 0.0, None) ** 2)
