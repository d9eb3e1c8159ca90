"""Scatter of points' distances to a sphere: its growth with the incidence, and its correlation among neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.statistics import mad_sigma

LEAST_SIGMA_MM = 1e-6  # of a scan without noise
_BINS = 12
_POINTS_A_BIN = 25
_MOST_GROWTH = 12.0
_PATCHES = 48
_PLAIN = 1.5  # a ratio of variances below this is that of white noise in some tens of patches
_LEAST_COSINE = 0.15


@dataclass(frozen=True)
class NoiseGrowth:
    """Sigma of the distances over the surface by incidence i: sigma_mm exp(b_1 g + b_2 g^2), g = -log cos i."""

    sigma_mm: float  # seen squarely
    powers: Array  # (2,) b_1, b_2

    def sigma(self, sine: Array) -> Array:
        """Sigmas (K,) of the distances, mm, for sines (K,) of the incidence."""
        g = _lean(sine)
        return self.sigma_mm * np.clip(np.exp(self.powers[0] * g + self.powers[1] * g**2), 0.5, _MOST_GROWTH)


def _lean(sine: Array) -> Array:
    """Measure g = -log cos i (K,) of the incidence i, from sines (K,) of the incidence."""
    return -0.5 * np.log(np.maximum(1 - np.minimum(sine, 1.0) ** 2, _LEAST_COSINE**2))


def growth_of(over: Array, sine: Array) -> NoiseGrowth:
    """Growth of the noise with the incidence: MAD of the distances over the surface (K,) in bins of the incidence.

    Some of the distances may be no noise. Few points show one sigma, more show its growth, many show its curvature.
    """
    middle = float(np.median(over))
    level = max(mad_sigma(over - middle), LEAST_SIGMA_MM)
    bins = min(_BINS, len(over) // _POINTS_A_BIN)
    if bins < 3:
        return NoiseGrowth(level, np.zeros(2))
    order = np.argsort(sine)
    parts = np.array_split(order, bins)
    lean = np.array([float(np.mean(_lean(sine[part]))) for part in parts])
    spread = np.array([mad_sigma(over[part] - middle) for part in parts])
    count = np.array([len(part) for part in parts])
    log = np.log(np.maximum(spread, LEAST_SIGMA_MM))
    powers = 2 if bins >= 8 else 1
    design = np.column_stack([np.ones(bins), *(lean**k for k in range(1, powers + 1))])
    # A prior that the noise does not grow, of one bin's weight, keeps the curve from bending after a bad bin.
    penalty = np.diag([0.0, *([0.02] * powers)]) * count.mean()
    weighted = design.T * count
    solution = np.linalg.solve(weighted @ design + penalty, weighted @ log)
    bends = np.zeros(2)
    bends[:powers] = solution[1:]
    return NoiseGrowth(max(float(np.exp(solution[0])), LEAST_SIGMA_MM), bends)


def patch_factor(rows: Array, psi: Array, inverse: Array) -> float:
    """Factor by which errors correlated within patches enlarge the parameters' sigma; 1 where they do not.

    rows # (K, p) of the design over sigma, psi (K,) weighted residuals over sigma, inverse (p, p). Correlated errors of
    neighbours make the sums of a patch larger than those of independent points (the cluster-robust covariance, Liang
    and Zeger 1986). A form error of the sphere is included; an error that is smooth over the whole cap is not.
    """
    if len(rows) < 4 * _PATCHES:
        return 1.0
    patch = _patches(rows)
    sums = np.column_stack([np.bincount(patch, rows[:, k] * psi, minlength=_PATCHES) for k in range(rows.shape[1])])
    whole = inverse @ (sums.T @ sums) @ inverse
    alone = inverse @ ((rows * (psi**2)[:, None]).T @ rows) @ inverse
    lost = 1 - rows.shape[1] / np.count_nonzero(np.bincount(patch, minlength=_PATCHES))
    ratio = float(np.trace(whole[:3, :3]) / max(np.trace(alone[:3, :3]), 1e-300)) / max(lost, 0.5)
    return float(np.sqrt(ratio)) if ratio > _PLAIN else 1.0


def _patches(rows: Array) -> IndexArray:
    """Number (K,) of each point's patch: quantiles along two axes across the cap."""
    way = rows[:, :3] / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    centred = way - way.mean(axis=0)
    across = centred @ np.linalg.svd(centred[:: max(1, len(centred) // 2000)], full_matrices=False)[2][:2].T
    columns = 6
    column = np.searchsorted(np.quantile(across[:, 0], np.arange(1, columns) / columns), across[:, 0])
    patch = np.zeros(len(rows), dtype=np.int64)
    for k in range(columns):
        on = column == k
        each = _PATCHES // columns
        cuts = np.quantile(across[on, 1], np.arange(1, each) / each)
        patch[on] = k * each + np.searchsorted(cuts, across[on, 1])
    return patch
