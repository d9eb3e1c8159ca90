"""Heavy tails of the noise, told apart from a few points that are simply wrong.

    t         each point's coordinates follow Student's t, together (one variance a point) or each by itself
    outliers  k points lie anywhere, log-uniform in their distance; the others are normal

Both are compared with normal noise by their likelihood, the scale of each at its best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from calib.array_types import Array
from calib.fitting.noise import student_scale

_TAILS = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0)
_MOST_OUTLIERS = 0.1  # share of the points
_OUTLIER_RANGE = 30.0  # of the largest over the smallest distance of an outlier


@dataclass(frozen=True)
class TailTest:
    """Both explanations of far points, in nats over normal noise."""

    tail: float  # degrees of freedom
    of_tails: float
    of_outliers: float


def judge_tails(standardised: Array) -> TailTest:
    """The test of the tails of residuals (M, 3) in units of white noise."""
    square = np.sum(standardised**2, axis=1)
    each = (standardised**2).ravel()
    normal = _normal(square.sum(), 3 * len(square))
    together = [_student(square, 3, tail) for tail in _TAILS]
    alone = [_student(each, 1, tail) for tail in _TAILS]
    values = np.maximum(together, alone)
    best = int(np.argmax(values))
    return TailTest(_TAILS[best], float(values[best]) - normal, _outliers(square) - normal)


def _normal(square: float, count: int) -> float:
    """Log likelihood of `count` normal coordinates with this sum of squares."""
    return -0.5 * count * float(np.log(2.0 * np.pi * max(square / count, 1e-300)) + 1.0)


def _student(square: Array, size: int, tail: float) -> float:
    """Log likelihood of t of vectors of `size` coordinates, by their squared lengths."""
    scale = student_scale(square, tail, size)
    constant = gammaln(0.5 * (tail + size)) - gammaln(0.5 * tail) - 0.5 * size * np.log(tail * np.pi * scale)
    return float(np.sum(constant - 0.5 * (tail + size) * np.log1p(square / (tail * scale))))


def _outliers(square: Array) -> float:
    """The best log likelihood with some points anywhere, which of them counted as a choice among all."""
    count = len(square)
    from_far = np.sort(square)[::-1]
    out = []
    for k in range(int(_MOST_OUTLIERS * count) + 1):
        far = from_far[:k]
        anywhere = -np.log(np.log(_OUTLIER_RANGE)) - np.log(4.0 * np.pi) - 1.5 * np.log(np.maximum(far, 1e-300))
        chosen = gammaln(count + 1.0) - gammaln(k + 1.0) - gammaln(count - k + 1.0)
        out.append(_normal(float(from_far[k:].sum()), 3 * (count - k)) + float(anywhere.sum()) - float(chosen))
    return max(out)
