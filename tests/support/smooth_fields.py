"""Random smooth fields of a given correlation, by random Fourier features (Rahimi and Recht 2007).

A stationary kernel of the plane is the mean of cos(k . r) over its spectral density; a sum of cosines of random phase
whose wave vectors k are drawn from that density has the kernel as its covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

KERNELS = ("gaussian", "exponential", "measured")
_WAVES = 300


def smooth_field(points_mm: NDArray, length_mm: float, rng: np.random.Generator, kernel: str = "gaussian") -> NDArray:
    """A field (N,) of variance 1 over points (N, 2).

    Its correlation over a distance r is exp(-r^2 / 2 l^2) for "gaussian", exp(-r / l) for "exponential", and for
    "measured" the mean of both, with l / 27 in units of what a structured-light plane showed: l = 27 is 0.5 exp(-r /
    35) + 0.5 exp(-r^2 / 2 27^2), which is 0.98, 0.84, 0.63 and 0.26 at 1.5, 10, 22 and 45 mm.
    """
    turns = rng.standard_normal((2, _WAVES)) / length_mm
    if kernel != "gaussian":
        # exp(-r / l) is the mean of exp(-r^2 k^2 / 2) with k = 1 / (l |g|), g normal: the wave vectors are Cauchy's.
        rough = 1 / np.abs(rng.standard_normal(_WAVES))
        if kernel == "measured":
            rough = np.where(np.arange(_WAVES) % 2, rough * 27 / 35, 1.0)
        turns = turns * rough
    phase = points_mm @ turns + rng.uniform(0, 2 * np.pi, _WAVES)
    return np.asarray(np.sqrt(2 / _WAVES) * np.cos(phase).sum(axis=1))


def correlation(apart_mm: NDArray, length_mm: float, kernel: str = "gaussian") -> NDArray:
    """Correlation of such a field between points that are so far apart."""
    smooth, rough = np.exp(-(apart_mm**2) / 2 / length_mm**2), np.exp(-apart_mm / length_mm)
    if kernel == "measured":
        return np.asarray(0.5 * smooth + 0.5 * np.exp(-apart_mm / (length_mm * 35 / 27)))
    return smooth if kernel == "gaussian" else rough
