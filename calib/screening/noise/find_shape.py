"""The shape of the noise that a residual shows: one property after the other, while each gains enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import BoolArray
from calib.noise_shape import NoiseShape
from calib.screening.noise.likelihood import LinearResidual
from calib.screening.noise.properties import FoundShape, point_properties, wander_property
from calib.screening.noise.tails import judge_tails

MIN_GAIN = 8.0  # nats, for each property
DECLARED = NoiseShape()
_MOST = 250  # points that the shape of a single one is told from
TAIL_LEAD = 3.0  # nats, of tails over single points that are wrong


def find_shape(
    residual: LinearResidual,
    outlier: BoolArray,
    *,
    points: bool = True,
    slow: bool = True,
    start: NoiseShape = DECLARED,
) -> FoundShape | None:
    """The shape of the noise, where what is left shows more than the declared noise; None where it does not.

    Args:
        residual: what a fit left of M points.
        outlier: (M,) which stand out; they are left out unless the noise's shape explains them better.
        points: whether single points' noise may be reshaped; else only its course in time.
        slow: whether it may wander with time.
        start: what is known of the shape already.
    """
    found = _greedy(residual, np.zeros_like(outlier), points, slow, start)
    if outlier.any():
        without = _greedy(residual, outlier, points, slow, start)
        if without.gain + judge_tails(residual.standardised(start)).of_outliers > found.gain - TAIL_LEAD:
            found = without
    return None if found.shape == DECLARED else found


def _greedy(residual: LinearResidual, left_out: BoolArray, points: bool, slow: bool, start: NoiseShape) -> FoundShape:
    """One property after the other, the one that gains most first; without some points (M,)."""
    kept = residual.select(np.flatnonzero(~left_out))
    some = _spread(kept)
    shape, gain = start, 0.0
    while True:
        tried: list[FoundShape | None] = [wander_property(kept, shape) if slow and not shape.wander else None]
        if points:
            tried += [*point_properties(some, shape), None if left_out.any() else _with_tail(kept, shape)]
        better = [one for one in tried if one is not None and one.gain > MIN_GAIN]
        if not better:
            return FoundShape(shape, gain)
        best = max(better, key=lambda one: one.gain)
        shape, gain = kept.normalised(best.shape), gain + best.gain


def _spread(residual: LinearResidual) -> LinearResidual:
    """At most `_MOST` of the points: as many tell the shape of a single one's noise, and more only take time."""
    count = len(residual.rows)
    return residual.select(np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int)))


def _with_tail(residual: LinearResidual, shape: NoiseShape) -> FoundShape | None:
    """The shape with heavy tails, where they say more than single wrong points."""
    if shape.tail is not None:
        return None
    test = judge_tails(residual.standardised(shape))
    if test.of_tails < test.of_outliers + TAIL_LEAD:
        return None
    return FoundShape(replace(shape, tail=test.tail), test.of_tails)
