"""Whether the points of a scan are those of one view, or of several that were joined.

One view has at most one point for each pixel, so that neighbours in its image keep their distance. Points of several
views that overlap come nearer: of two grids one point in sixteen has another one nearer than a fifth of the usual
distance, of four one in eleven, of points without any order one in nine, whether they are of many views or were drawn
at random from a surface.

How far the views are off shows in the heights of such close points: they are of two views, those of other neighbours
only in part. For V views, each off by r, the mean squared difference is 2 r^2 / V larger, and their mean is off by half
of that, r^2 / V.

Clouds are often thinned to one point per cell of a cubic grid, the mean of those in it. Then nothing is left of the
views, but the points lie more often in the middle of a cell than near its sides: their coordinates repeat along all
three axes with one period, which is a little longer than the points' distance on the faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.corners.correlated_noise.patches import ScannerView
from calib.lazy_modules import spatial
from calib.planes.robust_fit import PlaneFit

_MOST_POINTS = 3_000  # of a face, that are looked at: those nearest to its middle
_FIRST_POINTS, _FEW_CLOSE = 800, 0.01  # so many are enough where no larger share of them has a close one
_FEWEST_POINTS = 200
_NEIGHBOURS = 12
_CLOSE, _SAME = 0.2, 1e-3  # of the usual distance: a point of another view, and one that was written twice
_MOST_CLOSE = 0.027  # share of points with a close one; laser lines have up to 0.01, rays anywhere in a pixel 0.022
_CLOSE_AT_RANDOM = 1 - np.exp(-np.pi * _CLOSE**2)  # that share of points without any order

_INFLATED = 3.0  # a variance told by one shift of three coordinates is exceeded so much more than a known one
_SURE = 2.0  # sigmas, of both signs together, that points are not those of one view in no order


_CELLS = (0.9, 1.6)  # times the points' distance: periods that are looked at
_PERIODIC = 0.06  # least amplitude along each axis; up to 0.03 of rays, 0.07 to 0.2 of means of two views
_MOST_FOR_CELLS = 8_000
_BINS_A_CELL = 8


@dataclass(frozen=True)
class JoinedViews:
    """Signs of several views in the points of three faces."""

    overlap: bool  # points come nearer to each other than those of one view can
    registration_mm: float  # sigma of the views' common shift, each axis, by how much they differ


def joined_views(planes: Sequence[PlaneFit], view: ScannerView) -> JoinedViews:
    """Signs of several views in the points of three faces."""
    if _close_pairs(planes, view, _FIRST_POINTS)[0] <= _FEW_CLOSE:
        return JoinedViews(False, 0.0)
    share, squares, of_others = _close_pairs(planes, view, _MOST_POINTS)
    if share <= _MOST_CLOSE:
        return JoinedViews(False, 0.0)
    pairs = len(squares) / 2
    excess_mm2 = float(np.mean(squares) - np.mean(of_others))
    unsure_mm2 = max(float(np.std(squares) / np.sqrt(pairs)), 1e-300)
    order = (_CLOSE_AT_RANDOM / share - 1) * np.sqrt(pairs)
    differ_mm2 = max(excess_mm2, 0.0) + unsure_mm2 if order + excess_mm2 / unsure_mm2 > _SURE else 0.0
    return JoinedViews(True, float(np.sqrt(_INFLATED * differ_mm2 / 2)))


def _close_pairs(planes: Sequence[PlaneFit], view: ScannerView, most: int) -> tuple[float, Array, Array]:
    """Share of points with a close one, squared differences of height of such pairs, and those of other neighbours.

    At most so many points of each face are looked at.
    """
    shares, of_close, of_others = [], [np.zeros(0)], [np.zeros(0)]
    for plane in planes:
        points = plane.points_mm
        if len(points) > most:  # a connected part, for a sparse selection is as random as joined views
            away = points - plane.centre_mm
            points = points[np.argpartition(np.einsum("ki,ki->k", away, away), most)[:most]]
        if len(points) < _FEWEST_POINTS:
            continue
        image_mm = view.image_mm(points)
        tree = spatial.cKDTree(image_mm, balanced_tree=False, compact_nodes=False)
        distance, near = (np.asarray(found) for found in tree.query(image_mm, k=_NEIGHBOURS + 1))
        usual = distance[:, -1] * np.sqrt(np.pi / _NEIGHBOURS)
        ratio = distance[:, 1] / np.maximum(usual, 1e-300)
        close = (ratio < _CLOSE) & (ratio > _SAME)
        shares.append(float(np.mean(close)))
        heights = points @ plane.normal
        of_close.append((heights - heights[near[:, 1]])[close] ** 2)
        of_others.append((heights[:, None] - heights[near[:, _NEIGHBOURS // 2 :]]).ravel() ** 2)
    return float(np.mean(shares)) if shares else 0.0, np.concatenate(of_close), np.concatenate(of_others)


def cell_mm(planes: Sequence[PlaneFit]) -> float:
    """Width of the cubic cells over which the points of three faces were averaged; 0 where they were not."""
    every = np.vstack([plane.points_mm for plane in planes])
    along = [(plane.points_mm - plane.centre_mm) @ plane.axes.T for plane in planes]
    area_mm2 = sum(6 * float(np.sqrt(max(np.linalg.det(np.cov(uv.T)), 0.0))) * np.sqrt(3) for uv in along)  # triangles
    apart_mm = float(np.sqrt(area_mm2 / len(every)))
    points = every[:: max(1, len(every) // _MOST_FOR_CELLS)]
    low, span_mm = points.min(axis=0), 1.001 * float(np.ptp(points, axis=0).max())
    bins = round(_BINS_A_CELL * span_mm / max(apart_mm, 1e-3 * span_mm))
    amplitude = np.min(
        [
            np.abs(np.fft.rfft(np.histogram(column, bins, (start, start + span_mm))[0]))
            for column, start in zip(points.T, low, strict=True)
        ],
        axis=0,
    )
    period_mm = span_mm / np.maximum(np.arange(len(amplitude)), 0.5)
    amplitude[(period_mm < _CELLS[0] * apart_mm) | (period_mm > _CELLS[1] * apart_mm)] = 0
    best = int(np.argmax(amplitude))
    return float(period_mm[best]) if amplitude[best] > _PERIODIC * len(points) else 0.0
