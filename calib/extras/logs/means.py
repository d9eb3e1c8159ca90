"""Means over standing phases, and how exact they are where successive samples share a part of their noise.

The integrated autocorrelation time tau = 1 + 2 sum rho(k), pooled over all phases, says how many successive samples
tell as much as one: sigma of a mean = scatter sqrt(tau / N). Source: A. Sokal, "Monte Carlo methods in statistical
mechanics" (1997), section 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.statistics import mad_sigmas, rms

_OUTLYING = 6.0  # standard deviations from the median: a sample that is left out
_WINDOW = 5.0  # autocorrelation times that the sum runs over


@dataclass(frozen=True)
class Means:
    """Means over phases with their scatter; what belongs to a phase without samples is NaN."""

    mean: Array  # (K, d)
    counts: Array  # (K,) samples
    left_out: int  # outlying samples of all phases
    scatter: Array  # (d,) standard deviation of one sample, pooled
    tau: float  # samples that tell as much as one
    sigma: Array  # (K,) of the mean, root mean square over the d values


def means_of(samples: Sequence[Array]) -> Means:
    """Means of the samples (N, d) of each phase, outlying ones left out."""
    d = max((each.shape[1] for each in samples), default=1)
    kept, mean, left_out = [], np.full((len(samples), d), np.nan), 0
    for k, each in enumerate(samples):
        good = each[_is_near(each)] if len(each) > 4 else each
        left_out += len(each) - len(good)
        kept.append(good)
        if len(good):
            mean[k] = good.mean(axis=0)
    away = [each - each.mean(axis=0) for each in kept if len(each) > 1]
    dof = sum(len(each) - 1 for each in away)
    scatter = np.sqrt(sum(((each**2).sum(axis=0) for each in away), np.zeros(d)) / max(dof, 1))
    tau = autocorrelation_time(away)
    counts = np.array([len(each) for each in kept], dtype=float)
    with np.errstate(divide="ignore"):
        sigma = rms(scatter) * np.sqrt(np.minimum(tau / counts, 1.0))
    return Means(mean, counts, left_out, scatter, tau, np.where(counts > 0, sigma, np.nan))


def _is_near(samples: Array) -> Array:
    """Whether each sample (N, d) is near the median: an instrument's wild readings are not."""
    off = np.abs(samples - np.median(samples, axis=0))
    return np.asarray(
        (off <= np.maximum(_OUTLYING * mad_sigmas(samples), 1e-12 + 1e-9 * np.abs(samples).max())).all(axis=1)
    )


def autocorrelation_time(away: Sequence[Array]) -> float:
    """Integrated autocorrelation time, in samples, of deviations (N, d) from each phase's mean; at least 1."""
    longest = max((len(each) for each in away), default=0)
    variance = sum(float((each**2).sum()) for each in away)
    if longest < 4 or variance == 0.0:
        return 1.0
    total = sum(each.size for each in away)
    tau = 1.0
    for lag in range(1, longest - 1):
        products = [(float((each[lag:] * each[:-lag]).sum()), each[lag:].size) for each in away if len(each) > lag + 1]
        count = sum(size for _, size in products)
        # A mean that was taken away makes correlations too small, by 1/N of the sum: given back.
        rho = (sum(value for value, _ in products) / count) / (variance / total) + tau / (
            total / len(away) / away[0].shape[1]
        )
        if lag >= _WINDOW * tau or rho <= 0.0:
            break
        tau += 2.0 * rho
    return max(tau, 1.0)
