"""Search for the noise shape (directions, growth with distance, drift, tails) from repeats or from a fit's residual.

The noise may be coarser along a direction, grow with distance, drift slowly or have heavy tails: one property is added
after the other, while each gains enough in log likelihood. A correlated drift of the instrument (Ornstein-Uhlenbeck) is
an alternative to every effect that was added: one that does not lead it clearly is not to be claimed in its place.

Heavy tails are told apart from a few points that are simply wrong by two explanations of far points,

    t         each point's coordinates follow Student's t, together (one variance a point) or each by itself
    outliers  k points lie anywhere, log-uniform in their distance; the others are normal

both compared with normal noise by their likelihood, the scale of each at its best.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset
from calib.fitting.noise import student_scale
from calib.noise_shape import IDENTITY, CorrelatedDrift, NoiseShape, Row
from calib.screening.noise_likelihood import LinearResidual, scatter_of_repeats
from calib.screening.projected_residual import ProjectedResidual

DECLARED = NoiseShape()
MIN_OVER_DRIFT = 3.0  # log Bayes factor of an effect over a drift, from which it may be claimed
MIN_DRIFT_EVIDENCE = 3.0  # of a drift, from which it counts as an alternative
MIN_GAIN = 8.0  # nats, for each property
MIN_TAIL_GAIN = 3.0  # nats, of tails over single points that are wrong
_MOST_POINTS = 250  # that the shape of a single point's noise is found by
_PARAMETER_COST = 2.5  # nats for each parameter of a property beyond its first: half the log of the equations
_MOST_RATIO = 2.5  # log of the largest ratio of two directions that is looked for
_MOST_GROWTH = 3.0  # log of the largest ratio over the measured distances
_NEAR = 0.2  # of the median distance: with a point nearer the origin is not where the instrument stands
_SHARES = (0.2, 0.35, 0.5, 0.7, 0.85, 0.97)
_TIMES = 8  # correlation times of a drift, from the spacing of the poses to half the session
_FEWEST_MOMENTS = 12
_TAILS = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0)
_MOST_OUTLIERS = 0.1  # share of the points
_OUTLIER_RANGE = 30.0  # of the largest over the smallest distance of an outlier


@dataclass(frozen=True)
class EstimatedNoise:
    """The noise shape estimated from the data."""

    shape: NoiseShape
    rival: str = ""  # an effect that was added first, and that a correlated drift explains as well
    from_repeats: bool = False  # else from the residual of a fit, as a drift always is


@dataclass(frozen=True)
class AddedEffect:
    """An effect that a search added, with its evidence and the residual before the addition."""

    effect: str
    log_evidence: float
    before: ProjectedResidual


def noise_of_repeats(dataset: Dataset) -> EstimatedNoise | None:
    """Noise shape estimated from repeated measurements, before any fit; None where it equals the declared noise."""
    scatter = scatter_of_repeats(dataset)
    if scatter is None:
        return None
    shown = find_shape(scatter, np.zeros(len(scatter.rows), dtype=bool), drifts=False)
    return None if shown is None else EstimatedNoise(shown.shape, from_repeats=True)


def first_unproven(added: Sequence[AddedEffect], outliers: Collection[str]) -> AddedEffect | None:
    """First added effect that a drift of the instrument explains about as well; None where there is none.

    Args:
        added: by a search, one after the other.
        outliers: ids of poses that stand out, which do not count.
    """
    return next((one for one in added if _log_bayes_factor_over_drift(one, outliers) < MIN_OVER_DRIFT), None)


def _log_bayes_factor_over_drift(added: AddedEffect, outliers: Collection[str]) -> float:
    """Log Bayes factor of an effect over a correlated drift; inf where a drift has almost no evidence."""
    kept = np.flatnonzero(~_of_poses(added.before, outliers))
    drift = drift_property(LinearResidual.of(added.before).select(kept), DECLARED)
    return np.inf if drift is None or drift.gain < MIN_DRIFT_EVIDENCE else added.log_evidence - drift.gain


def noise_of_residual(
    dataset: Dataset, unproven: AddedEffect | None, last: ProjectedResidual, outliers: Collection[str]
) -> EstimatedNoise | None:
    """Noise shape that fits a residual better than the shape used in the fit; None where none does.

    Where repeated measurements show the shape, only its drift is searched for. The repeats of a fitted dataset may be
    averaged already: then its noise is what they showed.

    Args:
        dataset: that was fitted, with the noise as it was taken.
        unproven: the effect that does not lead a drift: then the residual before it counts, and the drift is there.
        last: the residual of the last fit.
        outliers: ids of poses that stand out.
    """
    projected = last if unproven is None else unproven.before
    residual, outlier = LinearResidual.of(projected), _of_poses(projected, outliers)
    drift = None if unproven is None else drift_property(residual.select(np.flatnonzero(~outlier)), DECLARED)
    shown = find_shape(
        residual,
        outlier,
        points=dataset.noise is None and scatter_of_repeats(dataset) is None,
        start=DECLARED if drift is None else drift.shape,
    )
    if shown is None:
        return None
    shape = shown.shape if dataset.noise is None else replace(dataset.noise, wander=shown.shape.wander)
    rival = "" if unproven is None else unproven.effect
    return EstimatedNoise(shape, rival, from_repeats=dataset.noise is not None)


def _of_poses(projected: ProjectedResidual, pose_ids: Collection[str]) -> BoolArray:
    """Mask (M,) of the points that were measured at the given poses."""
    poses, row = projected.residuals.observed.used_poses
    return np.asarray(np.isin(np.array(poses.ids), list(pose_ids))[row])


# ---- one property after the other -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class FoundShape:
    """A noise shape with its gain in log likelihood over an earlier shape, nats, less a cost per parameter."""

    shape: NoiseShape
    gain: float


def find_shape(
    residual: LinearResidual,
    outlier: BoolArray,
    *,
    points: bool = True,
    drifts: bool = True,
    start: NoiseShape = DECLARED,
) -> FoundShape | None:
    """Noise shape that fits a residual best; None where that is the declared one.

    Args:
        residual: at M points.
        outlier: (M,) points that stand out; they are left out unless the noise's shape explains them better.
        points: whether single points' noise may be reshaped; else only its course in time.
        drifts: whether it may drift with time.
        start: what is known of the shape already.
    """
    found = _greedy(residual, np.zeros_like(outlier), points, drifts, start)
    if outlier.any():
        without = _greedy(residual, outlier, points, drifts, start)
        if without.gain + judge_tails(residual.standardised(start)).of_outliers > found.gain - MIN_TAIL_GAIN:
            found = without
    return None if found.shape == DECLARED else found


def _greedy(residual: LinearResidual, left_out: BoolArray, points: bool, drifts: bool, start: NoiseShape) -> FoundShape:
    """Noise shape built by adding the property with the largest gain, one at a time; `left_out` points are ignored."""
    kept = residual.select(np.flatnonzero(~left_out))
    some = _spread(kept)
    shape, gain = start, 0.0
    while True:
        tried: list[FoundShape | None] = [drift_property(kept, shape) if drifts and not shape.wander else None]
        if points:
            tried += [*point_properties(some, shape), None if left_out.any() else _with_tail(kept, shape)]
        better = [one for one in tried if one is not None and one.gain > MIN_GAIN]
        if not better:
            return FoundShape(shape, gain)
        best = max(better, key=lambda one: one.gain)
        shape, gain = kept.normalised(best.shape), gain + best.gain


def _spread(residual: LinearResidual) -> LinearResidual:
    """The residual at up to `_MOST_POINTS` evenly spread points, enough for the noise shape of single points."""
    count = len(residual.rows)
    return residual.select(np.unique(np.linspace(0, count - 1, min(count, _MOST_POINTS)).astype(int)))


def point_properties(residual: LinearResidual, shape: NoiseShape) -> Iterator[FoundShape]:
    """Noise shapes with one more property of single points: growth with distance, or another sigma along an axis."""
    weights = residual.weights(shape)
    before = residual.log_likelihood(shape, weights)

    def gain(tried: NoiseShape) -> float:
        return residual.log_likelihood(tried, weights) - before

    distance_mm = np.linalg.norm(residual.xyz_mm, axis=1)
    outside = float(distance_mm.min()) > _NEAR * float(np.median(distance_mm))
    if shape.growth_per_m == 0.0 and outside and np.ptp(distance_mm) > 1e-6:
        middle, reach_m = float(distance_mm.mean()), 1e-3 * float(np.ptp(distance_mm))

        def growing(per_m: float) -> NoiseShape:
            return replace(shape, growth_per_m=per_m, distance_mm=middle)

        yield _along_line(lambda v: gain(growing(v)), growing, _MOST_GROWTH / reach_m)
    if shape.depth != 1.0 or shape.axes != IDENTITY:
        return
    if outside:
        yield _along_line(lambda v: gain(_deep(shape, v)), lambda v: _deep(shape, v), _MOST_RATIO)
    for axis in range(3):

        def stretched(log_size: float, axis: int = axis) -> NoiseShape:
            out = np.eye(3)
            out[axis, axis] = np.exp(log_size)
            return replace(shape, axes=_rows(out))

        yield _along_line(lambda v: gain(stretched(v)), stretched, _MOST_RATIO)
    yield _free_axes(gain, shape)


def drift_property(residual: LinearResidual, shape: NoiseShape) -> FoundShape | None:
    """Noise shape with the likeliest correlated drift; its gain is the mean likelihood relative to no drift.

    None with too few moments.
    """
    moments = residual.moments
    gaps = moments.gap[np.isfinite(moments.gap)]
    if len(gaps) < _FEWEST_MOMENTS:
        return None
    sessions = len(moments.gap) - len(gaps)
    longest = 0.5 * float(np.sum(gaps)) / sessions
    times = np.geomspace(min(0.7 * float(np.median(gaps)), 0.5 * longest), longest, _TIMES)
    drifts = [CorrelatedDrift(share, float(time), moments.in_poses) for time in times for share in _SHARES]
    weights = residual.weights(shape)
    values = np.array(residual.log_likelihoods(shape, drifts, weights))
    top = int(np.argmax(values))
    mean = float(values[top] + np.log(np.mean(np.exp(values - values[top]))))
    return FoundShape(replace(shape, wander=drifts[top]), mean - residual.log_likelihood(shape, weights))


def _deep(shape: NoiseShape, log_depth: float) -> NoiseShape:
    return replace(shape, depth=float(np.exp(log_depth)))


def _along_line(gain: Callable[[float], float], shape: Callable[[float], NoiseShape], most: float) -> FoundShape:
    """Noise shape with the largest gain over one number, searched within +-`most`."""
    from scipy.optimize import minimize_scalar  # takes a sixth of a second to load

    found = minimize_scalar(
        lambda v: -gain(v), bounds=(-most, most), method="bounded", options={"xatol": 0.005 * most}
    ).x
    return FoundShape(shape(found), gain(found))


def _free_axes(gain: Callable[[NoiseShape], float], shape: NoiseShape) -> FoundShape:
    """Noise shape with arbitrary axes: the exponential of a symmetric traceless matrix of five free numbers."""

    def with_axes(numbers: Array) -> NoiseShape:
        a, b, c, d, e = numbers
        size, turn = np.linalg.eigh(np.array([[a, c, d], [c, b, e], [d, e, -a - b]]))
        return replace(shape, axes=_rows((turn * np.exp(np.clip(size, -_MOST_RATIO, _MOST_RATIO))) @ turn.T))

    def loss(numbers: Array) -> float:
        return -gain(with_axes(numbers))

    from scipy.optimize import minimize

    at, value = np.zeros(5), 0.0
    for steps in (3, 25):  # a few tell whether there is anything to find
        found = minimize(
            loss, at, method="L-BFGS-B", options={"maxiter": steps, "gtol": 0.05, "ftol": 0.0, "eps": 1e-6}
        )
        at, value = found.x, -found.fun
        if value < 4.0 * _PARAMETER_COST:
            break
    return FoundShape(with_axes(at), value - 4.0 * _PARAMETER_COST)


def _rows(matrix: Array) -> tuple[Row, Row, Row]:
    first, second, third = ((float(a), float(b), float(c)) for a, b, c in matrix)
    return first, second, third


# ---- tails ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TailTest:
    """Log likelihoods, in nats over normal noise, of two explanations of far points: heavy tails, or outliers."""

    tail: float  # degrees of freedom
    of_tails: float
    of_outliers: float


def judge_tails(standardised: Array) -> TailTest:
    """Comparison of heavy tails with outliers as explanation of the largest residuals (M, 3), in units of sigma."""
    square = np.sum(standardised**2, axis=1)
    each = (standardised**2).ravel()
    normal = _normal(square.sum(), 3 * len(square))
    together = [_student(square, 3, tail) for tail in _TAILS]
    alone = [_student(each, 1, tail) for tail in _TAILS]
    values = np.maximum(together, alone)
    best = int(np.argmax(values))
    return TailTest(_TAILS[best], float(values[best]) - normal, _outliers(square) - normal)


def _with_tail(residual: LinearResidual, shape: NoiseShape) -> FoundShape | None:
    """Noise shape with heavy tails, where these explain far points better than a few outliers do; else None."""
    if shape.tail is not None:
        return None
    test = judge_tails(residual.standardised(shape))
    if test.of_tails < test.of_outliers + MIN_TAIL_GAIN:
        return None
    return FoundShape(replace(shape, tail=test.tail), test.of_tails)


def _normal(square: float, count: int) -> float:
    """Log likelihood of `count` normally distributed coordinates with a given sum of squares."""
    return -0.5 * count * float(np.log(2.0 * np.pi * max(square / count, 1e-300)) + 1.0)


def _student(square: Array, size: int, tail: float) -> float:
    """Log likelihood of vectors of `size` coordinates under Student's t distribution, by their squared lengths."""
    scale = student_scale(square, tail, size)
    constant = gammaln(0.5 * (tail + size)) - gammaln(0.5 * tail) - 0.5 * size * np.log(tail * np.pi * scale)
    return float(np.sum(constant - 0.5 * (tail + size) * np.log1p(square / (tail * scale))))


def _outliers(square: Array) -> float:
    """Best log likelihood with some points as outliers at any place, less the log of the ways to choose them."""
    count = len(square)
    from_far = np.sort(square)[::-1]
    out = []
    for k in range(int(_MOST_OUTLIERS * count) + 1):
        far = from_far[:k]
        anywhere = -np.log(np.log(_OUTLIER_RANGE)) - np.log(4.0 * np.pi) - 1.5 * np.log(np.maximum(far, 1e-300))
        chosen = gammaln(count + 1.0) - gammaln(k + 1.0) - gammaln(count - k + 1.0)
        out.append(_normal(float(from_far[k:].sum()), 3 * (count - k)) + float(anywhere.sum()) - float(chosen))
    return max(out)
