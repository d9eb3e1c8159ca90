"""One face's plane from all its points: robust total least squares, and its residuals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray

TUKEY = 6.0  # 98 % efficiency for normal residuals; 95 % at the usual 4.685
MAD_TO_SIGMA = 1.4826
_REWEIGHTINGS = 12
_SETTLED = 1e-3  # of the slope's own standard deviation
_LEAST_SIGMA_MM = 1e-9  # of a scan without noise


@dataclass(frozen=True)
class PlaneFit:
    """One face's robust fit, in coordinates around some origin near the apex."""

    normal: Array  # (3,) unit, toward the scanner
    offset_mm: float
    centre_mm: Array  # (3,) weighted
    axes: Array  # (2, 3) two directions in the plane
    indices: IndexArray  # (K,) into the scan, of the inliers: points with a weight
    points_mm: Array  # (K, 3)
    psi_mm: Array  # (K,) heights over the plane times Tukey's weights
    slope: float  # mean of psi': a height enters the fit as psi / slope
    sigma_mm: float  # 1.4826 MAD of the heights

    def design(self, points_mm: Array) -> Array:
        """Rows (K, 3) of a = (1, u, v): how the plane's height and its two slopes move its height at each point."""
        return np.column_stack([np.ones(len(points_mm)), (points_mm - self.centre_mm) @ self.axes.T])


def fit_plane_robustly(points: Array, indices: IndexArray, normal: Array, offset: float) -> PlaneFit:
    """Iteratively reweighted total least squares, starting from the plane normal . p = offset. points  # (K, 3)

    The scale s is the MAD of the heights h over the plane before; a weight is (1 - (h / 6 s)^2)^2, beyond that 0.
    To first order the estimate is ordinary least squares on the pseudo-values psi / mean(psi'), psi = w h (Huber 1981,
    section 7.6), whose residuals are those values at the solution.
    """
    heights = points @ normal - offset
    for _ in range(_REWEIGHTINGS):
        middle = np.median(heights)
        sigma = max(float(MAD_TO_SIGMA * np.median(np.abs(heights - middle))), _LEAST_SIGMA_MM)
        weights = _tukey(heights - middle, sigma)
        centre = weights @ points / weights.sum()
        centred = points - centre
        scatter, columns = np.linalg.eigh((centred * weights[:, None]).T @ centred)
        axes = columns.T  # rows, the normal first
        turned = axes[0] if axes[0] @ normal >= 0 else -axes[0]
        slope_sigma = sigma / np.sqrt(max(float(scatter[1]), 1e-300))
        settled = np.linalg.norm(turned - normal) < max(1e-9, _SETTLED * slope_sigma)
        normal, heights = turned, centred @ turned
        if settled:
            break
    weights = _tukey(heights, sigma)
    inlier = weights > 0
    root = np.sqrt(weights[inlier])
    slope = float(np.mean(root * (5 * root - 4)))  # psi' = (1 - z^2)(1 - 5 z^2), with 1 - z^2 = root
    psi = (weights * heights)[inlier]
    offset = float(normal @ centre)
    return PlaneFit(normal, offset, centre, axes[1:], indices[inlier], points[inlier], psi, slope, sigma)


def _tukey(heights: Array, sigma_mm: float) -> Array:
    return np.clip(1 - (heights / (TUKEY * sigma_mm)) ** 2, 0, None) ** 2
