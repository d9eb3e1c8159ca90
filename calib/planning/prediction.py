"""Predicted error of a fit at poses outside the fit, with the band that holds 90 % of arms.

The fitted model's error at a region's points is linear in the unknowns' errors, of covariance C: its mean square over
the points is e^T G e with e ~ N(0, C), G the mean of columns^T columns. Its mean over all arms is trace(G C). For one
arm it is a sum of chi-square variables, weighted by the eigenvalues of L^T G L (C = L L^T). Few of these are large, so
it varies from arm to arm. What the fit is known to miss (`calib.calibration.promise`) is added to each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.planning.exchange import inverse
from calib.planning.unknowns import Unknowns
from calib.statistics import covariance_root

SHARE = 0.9  # share of arms within the band
_DRAWS = 2000
STEP = 5  # poses that are added at a time
PAYS = 0.05  # share of the error by which `STEP` more poses have to lower it


@dataclass(frozen=True)
class Region:
    """Poses at which the planned model is to be accurate."""

    name: str
    poses: Poses
    columns_mm: Array  # (T, 3 t, K) `Unknowns.columns_mm` for T poses, t targets
    noise_mm2: float  # mean square of a point's noise, three dimensions
    missed_mm2: float = 0.0  # mean square of what the model is known to miss, three dimensions

    @classmethod
    def of(cls, name: str, poses: Poses, unknowns: Unknowns, missed_mm2: float = 0.0) -> Region:
        """Region made of some poses, with the derivatives of their points by the unknowns."""
        return cls(name, poses, unknowns.columns_mm(poses), unknowns.noise_mm2(poses), missed_mm2)

    @property
    def target_combinations(self) -> Array:
        """Combinations (K, m) of unknowns, mm, whose variances sum to the mean square error of a point."""
        return self.columns_mm.reshape(-1, self.columns_mm.shape[-1]).T / np.sqrt(self.points)

    @property
    def points(self) -> int:
        """Number of points, one for each target of each pose."""
        return self.columns_mm.shape[0] * self.columns_mm.shape[1] // 3


@dataclass(frozen=True)
class Prediction:
    """Predicted 3D RMS error of a model over a region, mm."""

    geometry_mm: float  # without noise, root mean square over arms
    low_mm: float  # lower end of the band of 90 % of arms, without noise
    high_mm: float  # upper end
    with_noise_mm: float  # as measured, each point with its noise


def predicted(region: Region, information: Array, noise_dof: float, rng: np.random.Generator) -> Prediction:
    """Predicted error over a region of a fit with information matrix (K, K), whose noise has `noise_dof`."""
    root = covariance_root(inverse(information))
    return _of_weights(_weights(region.target_combinations.T @ root), region, noise_dof, rng)


def predicted_once_placed(region: Region, unknowns: Unknowns, noise_dof: float, rng: np.random.Generator) -> Prediction:
    """Predicted error over a region before any new pose, with the scanner's frame fitted to the region.

    The parameters of an arm that was never measured are off by their tolerances, those of a fit by their uncertainty.
    """
    p = len(unknowns.scales)
    targets = region.target_combinations.T
    frame = targets[:, p:]
    parameters = targets[:, :p] - frame @ (np.linalg.pinv(frame, rcond=1e-9) @ targets[:, :p])
    root = np.linalg.cholesky(inverse(unknowns.prior_information)[:p, :p])
    return _of_weights(_weights(parameters @ root), region, noise_dof, rng)


def _weights(combinations: Array) -> Array:
    """Weights, mm^2, of the chi-square variables that make up the mean square error of a prediction."""
    return np.asarray(np.linalg.svd(combinations, compute_uv=False) ** 2)


def _of_weights(weights: Array, region: Region, noise_dof: float, rng: np.random.Generator) -> Prediction:
    """Prediction whose mean square error is a sum of chi-square variables with given weights, mm^2, and what is missed.

    What the model misses has many independent causes over a region, so that its mean square hardly varies.
    """
    mean = float(weights.sum()) + region.missed_mm2
    drawn = rng.chisquare(1.0, (_DRAWS, len(weights))) @ weights
    if np.isfinite(noise_dof) and noise_dof > 2.0:
        drawn *= noise_dof / rng.chisquare(noise_dof, _DRAWS)
    drawn += region.missed_mm2
    low, high = np.sqrt(np.quantile(drawn, [0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE]))
    return Prediction(float(np.sqrt(mean)), float(low), float(high), float(np.sqrt(mean + region.noise_mm2)))


def enough_poses(curve: Array, first: int = 0) -> int | None:
    """Least number of new poses from which five more lower the error by less than 5 %; None where the curve is short.

    Args:
        curve: (n + 1,) error by the number of new poses, from 0.
        first: least number to consider.
    """
    for count in range(first, len(curve) - STEP):
        if curve[count + STEP] > (1.0 - PAYS) * curve[count]:
            return count
    return None
