"""Tukey biweights for outlying measurements. Off by default: what looks like an outlier is often a missing effect.

Iteratively reweighted least squares: a point whose residual is r sigma away (in the metric of its covariance) counts
with the weight (1 - (r / c)^2)^2, which is zero beyond c (Beaton and Tukey 1974). A full pose is one point of six
coordinates: position and orientation have one weight, by the length of all six in the metric of their covariance. The
scale is the median over all points, so the declared sigma need not be right. A weight divides the point's covariance,
so the scanner's frames are fitted with the same weights as the parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import special

from calib.array_types import Array, IndexArray
from calib.distributions import chi_median
from calib.fitting.fit import Fit
from calib.fitting.observations import Observations, weighted
from calib.fitting.pose_residuals import PoseResiduals
from calib.fitting.residual import Residuals
from calib.fitting.trust_region import solve

_EFFICIENCY = 0.95  # for normal errors
_TUKEY = {3: 5.490, 6: 6.356}  # c of that efficiency by the number of coordinates (4.685 in one)
_LEAST = 1e-6  # weight of a point at c; less beyond, so that covariances stay finite and outliers add no cost
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
        make: residuals from observations; three rows a point, six where a full pose is fitted, point after point.
        observed: the points with their covariances.
        start, prior: as of `solve`.

    Returns:
        The fit, and the weights (M,). Its noise and covariance are those of the points that were not rejected.
    """
    residuals = make(observed)
    rows = rows_of_points(residuals, observed)
    fit = solve(residuals, start=start, prior=prior)
    weights = np.ones(len(observed.points))
    for _ in range(_ROUNDS):
        norm = point_norms(residuals.residual(fit.x), rows) / np.sqrt(weights)
        new = _kept_above_zero(tukey_weights(norm, rows), norm)
        settled = bool(np.max(np.abs(new - weights)) < 1e-3)
        weights = new
        residuals = make(weighted(observed, weights))
        fit = solve(residuals, start=fit.x, prior=prior)
        if settled:
            break
    return _with_noise_of_counted(fit, weights, rows, prior=prior), weights


def rows_of_points(residuals: Residuals, observed: Observations) -> IndexArray:
    """(M,) how many of the residual's rows are each point's."""
    rows = np.full(len(observed.points), 3)
    return rows + 3 * residuals.has_orientation if isinstance(residuals, PoseResiduals) else rows


def point_norms(residual: Array, rows: IndexArray) -> Array:
    """(M,) length of each point's whitened residual, of so many rows (M,) each."""
    first = np.concatenate([[0], np.cumsum(rows)[:-1]])
    return np.asarray(np.sqrt(np.add.reduceat(residual**2, first)))


def tukey_weights(norm: Array, rows: IndexArray) -> Array:
    """(M,) weights of residuals of these lengths and numbers of rows, 3 or 6, scaled by their median."""
    scale = float(np.median(norm / _by_rows(rows, chi_median)))
    if scale <= 0.0:
        return np.ones_like(norm)
    furthest = scale * _by_rows(rows, _TUKEY.__getitem__)
    return np.asarray(np.clip(1.0 - (norm / furthest) ** 2, 0.0, None) ** 2)


def _by_rows(rows: IndexArray, of: Callable[[int], float]) -> Array:
    numbers, index = np.unique(rows, return_inverse=True)
    return np.array([of(int(number)) for number in numbers])[index]


def _kept_above_zero(weights: Array, norm: Array) -> Array:
    """The weights, those of rejected points so small that all of them together add nothing to the cost."""
    far = norm / max(float(np.median(norm)), 1e-300)
    return np.maximum(weights, _LEAST / np.maximum(far, 1.0) ** 2)


def _with_noise_of_counted(fit: Fit, weights: Array, rows: IndexArray, *, prior: bool) -> Fit:
    """The fit with the noise and the covariance of the points that count, rejected ones left out.

    Weights make squares smaller: of d normal coordinates the mean weighted square is sigma^2 E[w r^2] / d. And the
    estimate's covariance is that of least squares over the efficiency, E[psi^2] / E[psi']^2 with psi = w r, where
    weighted least squares would say 1 / E[w].
    """
    counted = weights > _LEAST
    left = fit.degrees_of_freedom - float(rows[~counted].sum())
    if not np.isfinite(fit.noise) or left <= 0.5:
        return fit
    squares, mean = (np.average(_by_rows(rows, of), weights=rows) for of in (_weighted_square, _mean_weight))
    rejected = fit.degrees_of_freedom / left
    wider = rejected * mean / (squares * _EFFICIENCY)
    scales = np.array([p.scale for p in fit.parameters])
    covariance = fit.covariance / np.outer(scales, scales)
    if prior:  # its information is 1 and stays: (information / wider + 1)^-1
        covariance = np.asarray(
            np.linalg.solve(np.eye(len(scales)) + (wider - 1.0) * covariance, covariance), np.float64
        )
    return replace(
        fit,
        noise=fit.noise * float(np.sqrt(rejected / squares)),
        covariance=wider * covariance * np.outer(scales, scales),
        degrees_of_freedom=left,
    )


def _moment(power: int, rows: int) -> float:
    """E[r^power; r < c] of the length r of a vector of `rows` standard normal numbers."""
    half = 0.5 * (rows + power)
    inside = special.gammainc(half, 0.5 * _TUKEY[rows] ** 2)
    return float(2.0 ** (0.5 * power) * inside * np.exp(special.gammaln(half) - special.gammaln(0.5 * rows)))


def _mean_weight(rows: int) -> float:
    """E[w] of Tukey's weight for standard normal errors."""
    c2 = _TUKEY[rows] ** 2
    return _moment(0, rows) - 2.0 * _moment(2, rows) / c2 + _moment(4, rows) / c2**2


def _weighted_square(rows: int) -> float:
    """E[w r^2] / d for d = `rows` standard normal errors."""
    c2 = _TUKEY[rows] ** 2
    return (_moment(2, rows) - 2.0 * _moment(4, rows) / c2 + _moment(6, rows) / c2**2) / rows
