"""Errors of a model that are alike at neighbouring poses, which a check would otherwise take for a change.

A fit takes what its model misses for noise and parameters, so residual and covariance are both too small, and check
poses near each other are off together. What the left-out training poses prove of it (`calib.calibration.promise`)
counts in three places: the covariance of parameters and frame is larger, the check poses have a discrepancy that grows
with the distance to the training poses, and a residual with heavy tails tells less of the size of the noise.

Where nothing is proven nothing is added: on simulated arms whose model is right, the power of a check stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.promise import learned_with_gain, misfit_inflation
from calib.calibration.result import Calibration
from calib.fitting.discrepancy import Discrepancy, distances
from calib.fitting.observations import Observations
from calib.fitting.scanner_frame import whitener
from calib.statistics import covariance_root, group_numbers

PROVEN_INFLATION = 1.6  # of the covariance; of 25 simulated arms whose model is right the largest is 1.5
MOST_POSES = 1000  # of a check, up to which their likeness is counted: a matrix of as many rows
MOST_INFLATION = 100.0  # real arms have 2 to 7; more is a direction that the poses of one region alone determine
PROVEN_GAIN = 0.6  # in log likelihood by the discrepancy; of the same arms the largest is 0.25
PROVEN_TAILS = 2.0  # of the variance of squared errors, over that of normal ones


@dataclass(frozen=True)
class Misfit(Brief):
    """What a model is proven to miss, as a check of later poses counts it."""

    inflation: float  # factor of the covariance of parameters and frames
    discrepancy: Discrepancy | None  # None where none is proven
    tails: float  # variance of the poses' squared errors over that of normal errors
    joints: Discrepancy | None = None  # the training poses' joint vectors and the scale of their distances

    @classmethod
    def of(cls, calibration: Calibration) -> Misfit:
        """Misfit that the left-out training poses of a calibration prove."""
        inflation, tails = misfit_inflation(calibration), _tails(calibration)
        discrepancy, gain = learned_with_gain(calibration)
        chosen = bool(calibration.model.added_effects)  # by these very poses, whose residual they make small
        return cls(
            min(inflation, MOST_INFLATION) if chosen or inflation > PROVEN_INFLATION else 1.0,
            discrepancy if chosen or gain > PROVEN_GAIN else None,
            max(tails, 1.0) if chosen or tails > PROVEN_TAILS else 1.0,
            discrepancy,
        )

    def alike(self, q: Array) -> Array:
        """Correlation (N, N) of the residual's excess over the noise at joints (N, n): exp(-r / l).

        l is where a training pose's correlations with all of them, itself included, sum to the inflation: so much more
        than independent errors do alike ones move what is fitted to these poses.
        """
        known = self.joints
        if known is None or self.inflation <= 1.0 or len(q) > MOST_POSES:
            return np.eye(len(q))
        some = known.trained[np.unique(np.linspace(0, len(known.trained) - 1, 100).astype(int))]
        apart = np.array([distances(joints, known.trained, known.scale) for joints in some])
        lengths = np.geomspace(1e-3, 10.0, 60)
        sums = np.array([np.exp(-apart / length).sum(axis=1).mean() for length in lengths])
        length = lengths[min(int(np.searchsorted(sums, self.inflation)), len(lengths) - 1)]
        return np.exp(-np.array([distances(joints, q, known.scale) for joints in q]) / length)

    def root_mm(self, q: Array, excess_mm2: float = 0.0) -> Array:
        """Root L (N, K) of the covariance L L^T, mm^2 per coordinate, of what the model misses at joints (N, n).

        `excess_mm2`: variance of the residual over the noise, alike at neighbouring poses.

        Along a way through joint space the discrepancy is that of a Brownian motion which is zero at the nearest
        training poses: cov(i, j) = a (i = j) + b (r_i + r_j - r_ij) / 2, at least zero, r_ij the distance of i from j.
        """
        known = self.discrepancy
        if (known is None and excess_mm2 <= 0.0) or len(q) > MOST_POSES:
            return np.zeros((len(q), 0))
        covariance = excess_mm2 * self.alike(q)
        if known is not None:
            away = known.distance(q)
            apart = np.array([distances(joints, q, known.scale) for joints in q])
            covariance += 0.5 * known.growth_mm2 * np.maximum(away[:, None] + away - apart, 0.0)
            covariance += known.constant_mm2 * np.eye(len(q))
        return covariance_root(covariance)


def _tails(calibration: Calibration) -> float:
    """Variance of the squared errors of single training poses, over that of normal errors of the same size."""
    dataset, after = calibration.dataset, calibration.after
    observed = Observations.of_all(dataset)
    fitted = ~after.is_test if after.is_outlier is None else ~after.is_test & ~after.is_outlier
    rows = fitted[after.pose]
    whitened = np.einsum("mij,mj->mi", whitener(observed.covariance_mm2[rows]), after.error_mm[rows])
    squared = np.sum(whitened**2, axis=1)
    row = group_numbers(after.pose[rows])
    count = 3.0 * np.bincount(row)
    mean = np.bincount(row, squared) / count
    if len(count) < 16 or not mean.mean() > 0.0:
        return 1.0
    return float(np.var(mean, ddof=1) / mean.mean() ** 2 / np.mean(2.0 / count))
