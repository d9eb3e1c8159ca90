"""The error that a fit will have at poses that it has not seen, and how far one arm's may be from that.

The fitted model's error at a region's points is linear in the unknowns' errors, of covariance C: its mean square over
the points is e^T G e with e ~ N(0, C), G the mean of columns^T columns. Over all arms the mean of it is trace(G C). One
arm's is a sum of chi squared variables, weighted by the eigenvalues of L^T G L (C = L L^T). Few of these are large, so
it varies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.uncertainty import covariance_root
from calib.dataset.dataset import Poses
from calib.planning.question import inverse
from calib.planning.unknowns import Unknowns

SHARE = 0.9  # of arms within the band
_DRAWS = 2000
PAYS = 0.05  # share of the error by which five poses more have to lower it
STEP = 5


@dataclass(frozen=True)
class Region:
    """Poses at which the model is to be right."""

    words: str
    poses: Poses
    columns_mm: Array  # (T, 3 t, K) of `Unknowns.columns_mm`
    noise_mm2: float  # mean square of a point's noise there, three dimensions

    @classmethod
    def of(cls, words: str, poses: Poses, unknowns: Unknowns) -> Region:
        return cls(words, poses, unknowns.columns_mm(poses), unknowns.noise_mm2(poses))

    @property
    def wanted(self) -> Array:
        """(K, m) sums of unknowns whose variances add up to a point's mean square error."""
        return self.columns_mm.reshape(-1, self.columns_mm.shape[-1]).T / np.sqrt(self.points)

    @property
    def points(self) -> int:
        return self.columns_mm.shape[0] * self.columns_mm.shape[1] // 3


@dataclass(frozen=True)
class Prediction:
    """3D RMS of a model's error over a region, mm."""

    geometry_mm: float  # of the model's places, root mean square over arms
    low_mm: float  # 90 % of arms are between
    high_mm: float
    with_noise_mm: float  # as measured there, each point with its noise


def predicted(region: Region, information: Array, degrees_of_freedom: float, rng: np.random.Generator) -> Prediction:
    """The error of a fit with this information (K, K); its noise is known by so many degrees of freedom."""
    covariance = inverse(information)
    root = covariance_root(covariance)
    seen = region.wanted.T @ root
    return _of_weights(_squares(seen), region.noise_mm2, degrees_of_freedom, rng)


def predicted_once_placed(
    region: Region, unknowns: Unknowns, degrees_of_freedom: float, rng: np.random.Generator
) -> Prediction:
    """The error before any new pose, with the scanner placed by the region's own points.

    Of an arm that was never measured every parameter is off by its tolerance; of a fit as it knows them, where the
    scanner is put up anew.
    """
    p = len(unknowns.scales)
    wanted = region.wanted.T
    frame = wanted[:, p:]
    kept = wanted[:, :p] - frame @ (np.linalg.pinv(frame, rcond=1e-9) @ wanted[:, :p])
    root = np.linalg.cholesky(inverse(unknowns.known)[:p, :p])
    return _of_weights(_squares(kept @ root), region.noise_mm2, degrees_of_freedom, rng)


def _squares(seen: Array) -> Array:
    """The squares of a matrix's singular values."""
    return np.asarray(np.linalg.svd(seen, compute_uv=False) ** 2)


def _of_weights(weights: Array, noise_mm2: float, degrees_of_freedom: float, rng: np.random.Generator) -> Prediction:
    mean = float(weights.sum())
    drawn = rng.chisquare(1.0, (_DRAWS, len(weights))) @ weights
    if np.isfinite(degrees_of_freedom) and degrees_of_freedom > 2.0:
        drawn *= degrees_of_freedom / rng.chisquare(degrees_of_freedom, _DRAWS)
    low, high = np.sqrt(np.quantile(drawn, [0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE]))
    return Prediction(float(np.sqrt(mean)), float(low), float(high), float(np.sqrt(mean + noise_mm2)))


def enough_poses(curve: Array, first: int = 0) -> int | None:
    """From how many poses on, `first` or more, five more lower the error by less than 5 %.

    None where the curve ends before.

    curve  # (n + 1,) the error by the number of new poses, from 0
    """
    for count in range(first, len(curve) - STEP):
        if curve[count + STEP] > (1.0 - PAYS) * curve[count]:
            return count
    return None
