"""Robust total least squares of a plane through all points of a face, and its residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calib.array_types import Array, IndexArray
from calib.statistics import mad_sigma

TUKEY = 6.0  # 98 % efficiency for normal residuals; 95 % at the usual 4.685
_REWEIGHTINGS = 12
_SETTLED = 1e-2  # of the heights' standard error: a step that moves the plane less is the last
_LONGEST = 1.5  # times a step of plain reweighting
_SAME_SCALE = 0.1  # of the scale: a step that moves the heights less leaves it as it is
_OFF_PLANE = 0.3  # of the scale: a plane farther off has its heights weighed about their median
_ENOUGH_FOR_SCALE = 20_000  # heights; the scale has a standard error of 0.8 % then
_LEAST_SIGMA_MM = 1e-9  # of a scan without noise


@dataclass(frozen=True)
class PlaneFit:
    """Robustly fitted plane of one face, in coordinates about an origin near the apex."""

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
        """Rows (K, 3) of (1, u, v): derivatives of the plane's height at each point by its height and two slopes."""
        return np.column_stack([np.ones(len(points_mm)), (points_mm - self.centre_mm) @ self.axes.T])

    def with_heights(self) -> PlaneFit:
        """The same with its points' heights in place of their pseudo-values, which far points of a bow pull less."""
        return replace(self, psi_mm=self.points_mm @ self.normal - self.offset_mm, slope=1.0)

    def moved(self, move: Array) -> PlaneFit:
        """Plane moved by a height, mm, and two slopes, rad (3,), which keeps its points and their pseudo-values."""
        turned = self.normal - move[1:] @ self.axes
        normal = turned / np.linalg.norm(turned)
        offset_mm = float(normal @ self.centre_mm + move[0])
        return replace(
            self,
            normal=normal,
            offset_mm=offset_mm,
            centre_mm=self.centre_mm + move[0] * normal,
            axes=self.axes - np.outer(self.axes @ normal, normal),
        )


class PlaneAxes(Protocol):
    """Protocol of a plane's reference point and two in-plane directions, to which its height and slopes refer."""

    @property
    def centre_mm(self) -> Array: ...  # (3,)

    @property
    def axes(self) -> Array: ...  # (2, 3) unit


def height_lever(planes: Sequence[PlaneAxes], point_mm: Array) -> Array:
    """Matrix (3, 9) that converts the heights, mm, and slopes, rad, of three planes to their heights at a point, mm."""
    lever = np.zeros((3, 9))
    for i, plane in enumerate(planes):
        lever[i, 3 * i : 3 * i + 3] = 1.0, *(plane.axes @ (point_mm - plane.centre_mm))
    return lever


def fit_plane_robustly(points: Array, indices: IndexArray, normal: Array, offset: float) -> PlaneFit:
    """Plane through points (K, 3) by iteratively reweighted total least squares, started from normal . p = offset.

    The scale s is the MAD of the heights h over the previous plane; a weight is (1 - (h / 6 s)^2)^2, beyond that 0. To
    first order the estimate is ordinary least squares on the pseudo-values psi / mean(psi'), psi = w h (Huber 1981,
    section 7.6), whose residuals are those values at the solution. Steps are longer than those of reweighting by
    mean(w) / mean(psi'), which makes them nearly Newton's; half as many are enough.

    With coordinates (u, v) in the first plane and h0 over it, h = (h0 - a - b u - c v) / sqrt(1 + b^2 + c^2).
    """
    axes = _perpendicular(normal)
    start = points[0]
    design = np.empty((3, len(points)))
    design[0] = 1.0
    np.subtract(axes @ points.T, (axes @ start)[:, None], out=design[1:])  # small numbers
    first = normal @ points.T - offset
    heights, plane, size = first, np.zeros(3), 1.0
    sigma, moved = 0.0, np.inf
    for _ in range(_REWEIGHTINGS):
        if moved > _SAME_SCALE * sigma:
            middle, sigma = _middle_and_sigma(heights)
        root = _root(heights, middle, sigma)
        weights = root * root
        total = float(weights.sum())
        weighted = design * weights
        normal_matrix = weighted @ design.T
        step = _least_squares(normal_matrix, weighted @ heights)
        step *= total / max(float(root @ (5 * root - 4)), total / _LONGEST)  # psi' = root (5 root - 4)
        moved = math.sqrt(max(float(step @ normal_matrix @ step) / total, 0.0))
        plane += size * step
        size = math.sqrt(1 + plane[1] ** 2 + plane[2] ** 2)
        heights = (first - plane @ design) / size
        middle = 0.0
        if moved < max(_LEAST_SIGMA_MM, _SETTLED * sigma / math.sqrt(total)):
            break
    turned = (normal - plane[1:] @ axes) / size
    offset = (offset + float(plane[0] - plane[1:] @ axes @ start)) / size
    root = _root(heights, 0.0, sigma)
    inlier = np.flatnonzero(root > 0)
    root, kept = root[inlier], points.take(inlier, axis=0)
    weights = root * root
    centre = weights @ kept / weights.sum()
    centre -= (turned @ centre - offset) * turned
    slope = float(np.mean(root * (5 * root - 4)))
    psi = weights * heights[inlier]
    return PlaneFit(
        turned, float(offset), centre, _across(turned, kept, weights), indices[inlier], kept, psi, slope, sigma
    )


def _middle_and_sigma(heights: Array) -> tuple[float, float]:
    """Median of the heights (0 where it is small) and 1.4826 MAD; of very many heights every n-th is used."""
    some = heights[:: max(1, len(heights) // _ENOUGH_FOR_SCALE)]
    middle = float(np.median(some))
    sigma = max(mad_sigma(some - middle), _LEAST_SIGMA_MM)
    return (middle if abs(middle) > _OFF_PLANE * sigma else 0.0), sigma


def _root(heights: Array, middle: float, sigma_mm: float) -> Array:
    """Square roots of Tukey's weights of heights: 1 - z^2 with z the height in units of six sigmas; 0 beyond."""
    root = (heights - middle) * (1 / (TUKEY * sigma_mm))
    root *= root
    np.subtract(1.0, root, out=root)
    return np.maximum(root, 0.0, out=root)


def _least_squares(normal_matrix: Array, right: Array) -> Array:
    """Solution (3,) of weighted least squares: offset and two slopes of a plane.

    The slope in a direction in which the points do not spread is zero.
    """
    total, middle = normal_matrix[0, 0], normal_matrix[0, 1:] / normal_matrix[0, 0]
    spreads, turn = np.linalg.eigh(normal_matrix[1:, 1:] - total * np.outer(middle, middle))
    along = turn.T @ (right[1:] - middle * right[0])
    slopes = turn @ np.divide(along, spreads, out=np.zeros(2), where=spreads > 1e-12 * normal_matrix.trace())
    return np.array([right[0] / total - middle @ slopes, *slopes])


def _perpendicular(normal: Array) -> Array:
    """Two unit vectors (2, 3) that are perpendicular to each other and to a unit vector (3,)."""
    x, y, z = normal.tolist()
    sign = math.copysign(1.0, z)  # Duff and others, J. Comp. Graphics Techniques 6 (2017), 1
    a = -1 / (sign + z)
    b = x * y * a
    return np.array([[1 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y]])


def _across(normal: Array, points: Array, weights: Array) -> Array:
    """Principal directions (2, 3), in the plane, of the weighted points (K, 3), the one of less spread first."""
    axes = _perpendicular(normal)
    local = axes @ points.T
    total = weights.sum()
    local -= (local @ weights / total)[:, None]
    return np.linalg.eigh((local * weights) @ local.T)[1].T @ axes
