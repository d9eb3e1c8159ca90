"""Outlying poses: found from a resistant fit, and left out only where they lie far outside the bulk of all poses.

What looks like an outlier is often a missing effect, so poses are not down-weighted. A pose is left out where its
error is improbable given the bulk of all poses, for tails heavier than normal. The others are fitted by ordinary least
squares; without outliers that is the plain fit.

A pose pulls the fit towards itself, the more the fewer there are. Its error is therefore taken relative to a fit
without it: with the residual r of a pose and its block H of the hat matrix (parameters with prior, and frames),

    T = r^T (1 - H)^-1 r     of a pose that was fitted,
    T = e^T (1 + L)^-1 e     of one that was not, e its error, L what the fit's uncertainty adds to it,

each chi^2 times the noise's variance, with as many degrees of freedom as the pose has rows (Cook and Weisberg 1982,
section 2.2). The variance is estimated by the median over all poses.

Several outliers mask each other, and one of great leverage masks itself. The first set of poses therefore comes from an
iteratively reweighted fit with Tukey's biweight (Beaton and Tukey 1974), the median over all poses its scale.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.fitting.fit import Fit
from calib.fitting.noise import student_weights
from calib.fitting.observations import Observations, weighted
from calib.fitting.pose_residuals import PoseResiduals
from calib.fitting.position_residuals import PositionResiduals
from calib.fitting.residual import Residuals
from calib.fitting.trust_region import solve
from calib.statistics import chi2_ppf, chi_median, f_sf, group_numbers, left_out_by

F = TypeVar("F")  # the fit of `fit_inliers`

_TUKEY = {3: 5.490, 6: 6.356}  # c of 95 % efficiency by the number of coordinates (4.685 in one)
_LEAST = 1e-6  # weight of a point at c; less beyond, so that outliers add no cost
_TUKEY_ROUNDS = 12
_FIT_ROUNDS = 10
_OUT = 1e-14  # weight of a pose that is left out: small enough for whatever it is off
_TAIL = 5.0  # degrees of freedom of the bulk's tails: misfit is not normal
LEVEL = 0.05  # p, times the number of poses, below which a pose is an outlier
BACK_LEVEL = 0.5  # p, times the number of poses, above which a pose that an earlier fit left out is taken back
_FLOOR = 1e-12  # of the noise's variance over the declared one: exact data have rounding only
_TAIL_ROUNDS = 2


def fit_inliers(
    fit_of: Callable[[BoolArray], F],
    inliers: Callable[[F, BoolArray, float], BoolArray],
    kept: BoolArray,
    back_level: float,
) -> tuple[F, BoolArray]:
    """Robust fit: fit the inliers and test all poses against that fit, in turns, until the inliers are stable.

    Args:
        fit_of: fits the points where a mask (M,) is True.
        inliers: mask (M,) by `inlying_points` from a fit, the mask it was made with, and `back_level`.
        kept: mask (M,) of the points to begin with.
        back_level: p above which a rejected pose is taken back by the first fit; later `BACK_LEVEL`, against cycles.

    Returns:
        The fit, and the mask (M,) of its points: at least half of all.
    """
    fitted = fit_of(kept)
    for _ in range(_FIT_ROUNDS):
        now = inliers(fitted, kept, back_level)
        if np.array_equal(now, kept) or 2 * np.count_nonzero(now) < len(now):
            break
        kept, back_level = now, BACK_LEVEL
        fitted = fit_of(kept)
    return fitted, kept


def inlying_points(
    make: Callable[[Observations], PositionResiduals | PoseResiduals],
    observed: Observations,
    fit: Fit,
    kept: BoolArray,
    *,
    prior: bool,
    back_level: float,
) -> BoolArray:
    """Mask (M,) of the points at poses that agree with a fit of the points `kept` (M,).

    Args:
        make: residuals of the fit's model from observations.
        observed: all points.
        prior: whether the fit used a prior.
        back_level: p, times the number of poses, above which a pose that is not in `kept` is taken back.
    """
    pose = group_numbers(observed.points.pose)
    p_value = _p_values(make, observed, fit, kept, prior=prior) * (int(pose.max()) + 1)
    was_kept = np.ones(len(p_value), dtype=bool)
    was_kept[pose[~kept]] = False
    return np.asarray((p_value > np.where(was_kept, LEVEL, back_level))[pose])


def _p_values(
    make: Callable[[Observations], PositionResiduals | PoseResiduals],
    observed: Observations,
    fit: Fit,
    kept: BoolArray,
    *,
    prior: bool,
) -> Array:
    """p-value (N,) of each used pose's error, given a fit, by Fisher's F distribution."""
    weights = np.where(kept, 1.0, _OUT)
    residuals = make(weighted(observed, weights))
    at = residuals.linearise(fit.x)
    rows = rows_of_points(residuals, observed)
    unweighted = np.repeat(1.0 / np.sqrt(weights), rows)
    scales = np.array([p.scale for p in fit.parameters])
    jacobian = at.jacobian * scales
    square, turn = np.linalg.eigh(jacobian.T @ jacobian)
    information = np.maximum(square, 0.0) + (fit.reduced_chi**2 if prior and np.isfinite(fit.reduced_chi) else 0.0)
    known = information > 1e-12 * max(float(information[-1]), 1e-300)
    spread = np.where(known, 1.0 / np.sqrt(np.where(known, information, 1.0)), 0.0)
    lever = unweighted[:, None] * np.column_stack([residuals.frame_directions(fit.x), jacobian @ turn * spread])
    error = unweighted * at.residual
    row_pose = np.repeat(group_numbers(observed.points.pose), rows)
    row_kept = np.repeat(kept, rows)
    order = np.argsort(row_pose, kind="stable")
    blocks = np.split(order, np.flatnonzero(np.diff(row_pose[order])) + 1)
    size = np.array([len(block) for block in blocks], dtype=float)
    distance = np.array([_distance(error[block], lever[block], fitted=bool(row_kept[block[0]])) for block in blocks])
    median = np.array([chi2_ppf(0.5, dof) for dof in size])
    variance = max(float(np.median(distance / median)), _FLOOR)
    return np.array([f_sf(t / (d * variance), d, _TAIL) for t, d in zip(distance, size, strict=True)])


def _distance(error: Array, lever: Array, *, fitted: bool) -> float:
    """Squared Mahalanobis error of one pose, from its error (D,) and lever (D, K) of the fit on that error.

    That is the statistic T of the module, with lever lever^T = H, or L where the pose was not fitted.
    """
    of_fit = lever @ lever.T
    return float(error @ np.linalg.solve(left_out_by(of_fit if fitted else -of_fit), error))


def resistant_core(make: Callable[[Observations], Residuals], observed: Observations, *, prior: bool) -> BoolArray:
    """Mask (M,) of points at poses that a resistant (Tukey) fit keeps; nearly all outliers are left out.

    All points where it keeps less than half: then something else is wrong than single poses, such as a tool's place.
    """
    residuals = make(observed)
    rows = rows_of_points(residuals, observed)
    fit = solve(residuals, prior=prior)
    weights = np.ones(len(observed.points))
    for _ in range(_TUKEY_ROUNDS):
        norm = point_norms(residuals.residual(fit.x), rows) / np.sqrt(weights)
        new = _kept_above_zero(tukey_weights(norm, rows), norm)
        settled = bool(np.max(np.abs(new - weights)) < 0.01)
        weights = new
        residuals = make(weighted(observed, weights))
        fit = solve(residuals, start=fit.x, prior=prior)
        if settled:
            break
    pose = group_numbers(observed.points.pose)
    least = np.full(int(pose.max()) + 1, np.inf)
    np.minimum.at(least, pose, weights)
    kept = np.asarray((least > _LEAST)[pose])
    return kept if 2 * np.count_nonzero(kept) >= len(kept) else np.ones_like(kept)


def solve_with_tails(
    make: Callable[[Observations], Residuals],
    observed: Observations,
    tail: float,
    *,
    start: Array | None = None,
    prior: bool = True,
) -> Fit:
    """Least-squares fit for noise with Student's t distribution of `tail` degrees of freedom.

    The weights converge in a few rounds, as they change little with the fit. Residuals of distances, which share
    points, have no weights and are fitted plainly.
    """
    residuals = make(observed)
    fit = solve(residuals, start=start, prior=prior)
    rows = rows_of_points(residuals, observed)
    if fit.rows != rows.sum():
        return fit
    for _ in range(_TAIL_ROUNDS):
        norm = point_norms(make(observed).residual(fit.x), rows)
        weights = student_weights(3.0 * norm**2 / rows, tail)
        fit = solve(make(weighted(observed, weights)), start=fit.x, prior=prior)
    return fit


def rows_of_points(residuals: Residuals, observed: Observations) -> IndexArray:
    """Number (M,) of the residual's rows that belong to each point: 1, 3 or 6."""
    rows = np.full(len(observed.points), observed.points.coordinates)
    return rows + 3 * residuals.has_orientation if isinstance(residuals, PoseResiduals) else rows


def point_norms(residual: Array, rows: IndexArray) -> Array:
    """Length (M,) of each point's whitened residual.

    `rows` (M,) is the number of rows of each point.
    """
    first = np.concatenate([[0], np.cumsum(rows)[:-1]])
    return np.sqrt(np.add.reduceat(residual**2, first))


def tukey_weights(norm: Array, rows: IndexArray) -> Array:
    """Tukey's biweights (M,) from the lengths of the points' residuals, scaled by their median."""
    scale = float(np.median(norm / _by_rows(rows, chi_median)))
    if scale <= 0.0:
        return np.ones_like(norm)
    furthest = scale * _by_rows(rows, _TUKEY.__getitem__)
    return np.clip(1.0 - (norm / furthest) ** 2, 0.0, None) ** 2


def _by_rows(rows: IndexArray, of: Callable[[int], float]) -> Array:
    numbers, index = np.unique(rows, return_inverse=True)
    return np.array([of(int(number)) for number in numbers])[index]


def _kept_above_zero(weights: Array, norm: Array) -> Array:
    """Weights (M,) with zeros replaced by values so small that rejected points do not affect the cost."""
    near = np.minimum(float(np.median(norm)) / np.maximum(norm, 1e-300), 1.0)
    return np.maximum(weights, np.maximum(_LEAST * near**2, _OUT))
