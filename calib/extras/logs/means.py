"""Means over standing phases, and how exact they are where successive samples share a part of their noise.

The two halves of each phase tell it: their means differ by as much as means of so many samples scatter, tau times as
much in variance as means of independent samples would.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.statistics import mad_sigmas, rms

_OUTLYING = 6.0  # standard deviations from the median: a sample that is left out


@dataclass(frozen=True)
class Means:
    """Means over phases with their scatter; what belongs to a phase without samples is NaN."""

    mean: Array  # (K, d)
    counts: Array  # (K,) samples
    scatter: float  # standard deviation of one sample in one coordinate
    tau: float  # samples that tell as much as one
    sigma: Array  # (K,) of the mean in one coordinate


def means_of(samples: Sequence[Array]) -> Means:
    """Means of the samples (N, d) of each phase, outlying ones left out."""
    d = max((each.shape[1] for each in samples), default=1)
    kept = [each[_is_near(each)] if len(each) > 4 else each for each in samples]
    counts = np.array([len(each) for each in kept], dtype=float)
    mean = np.array([each.mean(axis=0) if len(each) else np.full(d, np.nan) for each in kept]).reshape(-1, d)
    away = [each - each.mean(axis=0) for each in kept if len(each) > 1]
    scatter = float(np.sqrt(sum(float(np.sum(a**2)) for a in away) / max(sum(len(a) - 1 for a in away) * d, 1)))
    between = [0.5 * np.sqrt(len(a)) * (a[: len(a) // 2].mean(axis=0) - a[len(a) // 2 :].mean(axis=0)) for a in away]
    tau = max((rms(between) / scatter) ** 2, 1.0) if scatter > 0.0 else 1.0
    with np.errstate(divide="ignore"):
        sigma = scatter * np.sqrt(np.minimum(tau / counts, 1.0))
    return Means(mean, counts, scatter, tau, np.where(counts > 0, sigma, np.nan))


def _is_near(samples: Array) -> Array:
    """Whether each sample (N, d) is near the median: an instrument's wild readings are not."""
    off, sigmas = np.abs(samples - np.median(samples, axis=0)), mad_sigmas(samples)
    sigmas = np.where(sigmas > 0.0, sigmas, samples.std(axis=0))  # of rounded values most may be one
    return np.asarray((off <= _OUTLYING * sigmas + 1e-9 * np.abs(samples).max()).all(axis=1))
