"""Covariances of a smooth error between patches: Gaussian kernels of all lengths, and rougher ones as their mixtures.

A kernel exp(-r / l) is the mean of exp(-r^2 / 2 s^2) over s / l distributed as the absolute value of a normal number,
so that one set of Gaussian kernels makes both: an error as smooth as lenses and one as rough as speckle.
"""

from __future__ import annotations

from math import erf, sqrt

import numpy as np

from calib.array_types import Array
from calib.corners.noise.patches import Places

LENGTHS = np.geomspace(1 / 30, 3.0, 14)
"""(L,) Correlation lengths l of the Gaussian kernels, in edges of the jig."""
ROUGH_FROM = 4
"""Index of the shortest length of an exponential kernel: shorter ones cannot be told from Gaussian ones by patches."""


def _mixture(length: float) -> Array:
    """(L,) shares of the Gaussian kernels in exp(-r / length)."""
    between = np.sqrt(LENGTHS[1:] * LENGTHS[:-1])
    below = [erf(b / length / sqrt(2)) for b in between]
    return np.diff([0.0, *below, 1.0])


SHAPES = np.vstack([np.eye(len(LENGTHS)), [_mixture(length) for length in LENGTHS[ROUGH_FROM:]]])
"""(S, L) shares of the Gaussian kernels in each shape of kernel: the Gaussian ones, then the exponential ones."""
SHAPE_LENGTHS = np.concatenate([LENGTHS, LENGTHS[ROUGH_FROM:]])
"""(S,) correlation lengths of the shapes, in edges."""


def gaussian_kernels(places: Places, lengths_mm: Array) -> Array:
    """(L, B, B) exp(-r^2 / 2 l^2) averaged over the points of each pair of patches, for lengths l (L,).

    With patches taken as Gaussian of their own second moments S the average is closed:
    l^2 / sqrt(det M) exp(-d . M^-1 d / 2), M = l^2 I + S_b + S_c.
    """
    x, y = (centre[:, None] - centre for centre in places.centres_mm.T)
    spreads = places.spreads_mm2
    xx, xy, yy = (spreads[:, i, j, None] + spreads[:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    square = (lengths_mm**2)[:, None, None]
    xx, yy = xx + square, yy + square
    determinant = xx * yy - xy**2
    way = (yy * (x * x) - 2 * xy * x * y + xx * (y * y)) / determinant
    return np.asarray(square / np.sqrt(determinant) * np.exp(-0.5 * way))
