"""Student's t for the noise of points: weights that make it as good as normal, and likelihoods.

A point's three coordinates are normal with a variance of their own, so that a whitened residual e counts with

    w = (nu + 3) / (nu + |e|^2 / s^2),   s^2 the mean of w |e|^2 / 3

(Lange, Little and Taylor 1989). Weights are scaled so that the residual keeps its size.
"""

from __future__ import annotations

import numpy as np

from calib.array_types import Array

_ROUNDS = 30


def student_scale(square: Array, tail: float, size: int = 3) -> float:
    """s^2 of squared lengths |e|^2 (M,) of `size` coordinates each, by maximum likelihood."""
    scale = max(float(np.median(square)) / size, 1e-300)
    for _ in range(_ROUNDS):
        scale = max(float(np.mean((tail + size) / (tail + square / scale) * square)) / size, 1e-300)
    return scale


def student_weights(square: Array, tail: float) -> Array:
    """(M,) weights of points by their squared lengths (M,), above 0.

    Scaled so that the weighted mean square is that of the residual itself, or that of the distribution,
    nu / (nu - 2) s^2, where a few far points make the residual's larger.
    """
    scale = student_scale(square, tail)
    weights = (tail + 3.0) / (tail + square / scale)
    size = min(float(np.mean(square)) / 3.0, tail / (tail - 2.0) * scale)
    return np.asarray(weights * (size / scale))
