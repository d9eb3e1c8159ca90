"""What noise may be other than white: coarser along a direction, growing with distance, slow; and what each gains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from calib.array_types import Array
from calib.noise_shape import IDENTITY, CorrelatedDrift, NoiseShape, Row
from calib.screening.noise.likelihood import LinearResidual

_PARAMETER_COST = 2.5  # nats for each parameter of a property beyond its first: half the log of the equations
_MOST_RATIO = 2.5  # log of the largest ratio of two directions that is looked for
_MOST_GROWTH = 3.0  # log of the largest ratio over the measured distances
_NEAR = 0.2  # of the median distance: with a point nearer the origin is not where the instrument stands
_SHARES = (0.2, 0.35, 0.5, 0.7, 0.85, 0.97)
_TIMES = 8  # of a wander, from the spacing of the poses to half the session
_FEWEST_MOMENTS = 12


@dataclass(frozen=True)
class FoundShape:
    """A shape, and what it is worth over the one that was there, in nats, less what its parameters cost."""

    shape: NoiseShape
    gain: float


def point_properties(residual: LinearResidual, shape: NoiseShape) -> Iterator[FoundShape]:
    """The shape with one property of single points more."""
    weights = residual.weights(shape)
    before = residual.likelihood(shape, weights)

    def gain(tried: NoiseShape) -> float:
        return residual.likelihood(tried, weights) - before

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


def wander_property(residual: LinearResidual, shape: NoiseShape) -> FoundShape | None:
    """The shape with the likeliest wander; its gain is the mean likelihood over shares and times, over none.

    None where too few moments could tell.
    """
    moments = residual.moments
    gaps = moments.gap[np.isfinite(moments.gap)]
    if len(gaps) < _FEWEST_MOMENTS:
        return None
    sessions = len(moments.gap) - len(gaps)
    longest = 0.5 * float(np.sum(gaps)) / sessions
    times = np.geomspace(min(0.7 * float(np.median(gaps)), 0.5 * longest), longest, _TIMES)
    wanders = [CorrelatedDrift(share, float(time), moments.in_poses) for time in times for share in _SHARES]
    weights = residual.weights(shape)
    values = np.array(residual.likelihoods(shape, wanders, weights))
    top = int(np.argmax(values))
    mean = float(values[top] + np.log(np.mean(np.exp(values - values[top]))))
    return FoundShape(replace(shape, wander=wanders[top]), mean - residual.likelihood(shape, weights))


def _deep(shape: NoiseShape, log_depth: float) -> NoiseShape:
    return replace(shape, depth=float(np.exp(log_depth)))


def _along_line(gain: Callable[[float], float], shape: Callable[[float], NoiseShape], most: float) -> FoundShape:
    """The best shape of one number within +-most."""
    found = minimize_scalar(
        lambda v: -gain(float(v)), bounds=(-most, most), method="bounded", options={"xatol": 0.005 * most}
    )
    return FoundShape(shape(float(found.x)), -float(found.fun))


def _free_axes(gain: Callable[[NoiseShape], float], shape: NoiseShape) -> FoundShape:
    """Any three axes: the exponential of a symmetric matrix without trace, five numbers."""

    def with_axes(numbers: Array) -> NoiseShape:
        a, b, c, d, e = numbers
        size, turn = np.linalg.eigh(np.array([[a, c, d], [c, b, e], [d, e, -a - b]]))
        return replace(shape, axes=_rows((turn * np.exp(np.clip(size, -_MOST_RATIO, _MOST_RATIO))) @ turn.T))

    def loss(numbers: Array) -> float:
        return -gain(with_axes(numbers))

    at, value = np.zeros(5), 0.0
    for steps in (3, 25):  # a few tell whether there is anything to find
        found = minimize(loss, at, method="BFGS", tol=0.05, options={"maxiter": steps})
        at, value = np.asarray(found.x), -float(found.fun)
        if value < 4.0 * _PARAMETER_COST:
            break
    return FoundShape(with_axes(at), value - 4.0 * _PARAMETER_COST)


def _rows(matrix: Array) -> tuple[Row, Row, Row]:
    first, second, third = ((float(a), float(b), float(c)) for a, b, c in matrix)
    return first, second, third
