"""Whether the points of a scan are those of one view, or of several that were joined.

One view has at most one point for each pixel, so that neighbours in its image keep their distance. Points of several
views that overlap come nearer: of two grids one point in sixteen has another one nearer than a fifth of the usual
distance, of points without any order one in nine. Joined grids still fill the image evenly, unlike points that were
drawn at random from a surface or from a denser scan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.corners.correlated_noise.patches import ScannerView
from calib.lazy_modules import spatial
from calib.planes.robust_fit import PlaneFit

_MOST_POINTS = 3_000  # of a face, that are looked at: those nearest to its middle
_FEWEST_POINTS = 200
_NEIGHBOURS = 12
_CLOSE, _SAME = 0.2, 1e-3  # of the usual distance: a point of another view, and one that was written twice
_MOST_CLOSE = 0.025  # share of points with a close one; scans of laser lines have up to 0.01
_IQR_TO_SIGMA = 1 / 1.349
_EVEN = 0.26  # relative scatter of the area that twelve neighbours take: up to 0.21 of joined grids, 0.29 at random


@dataclass(frozen=True)
class JoinedViews:
    """Signs of several views in the points of three faces."""

    overlap: bool  # points come nearer to each other than those of one view can
    even: bool  # they fill the image as evenly as a few grids do


def joined_views(planes: Sequence[PlaneFit], view: ScannerView) -> JoinedViews:
    """Signs of several views in the points of three faces."""
    close, scatter = [], []
    for plane in planes:
        image_mm = view.image_mm(plane.points_mm)
        if len(image_mm) > _MOST_POINTS:  # a connected part, for a sparse selection is as random as joined views
            away = np.sum((image_mm - np.median(image_mm, axis=0)) ** 2, axis=1)
            image_mm = image_mm[np.argpartition(away, _MOST_POINTS)[:_MOST_POINTS]]
        if len(image_mm) < _FEWEST_POINTS:
            continue
        distance = np.asarray(spatial.cKDTree(image_mm).query(image_mm, k=_NEIGHBOURS + 1)[0])
        usual = distance[:, -1] * np.sqrt(np.pi / _NEIGHBOURS)
        ratio = distance[:, 1] / np.maximum(usual, 1e-300)
        close.append(float(np.mean((ratio < _CLOSE) & (ratio > _SAME))))
        low, middle, high = np.quantile(distance[:, -1] ** 2, [0.25, 0.5, 0.75])
        scatter.append(_IQR_TO_SIGMA * float((high - low) / max(middle, 1e-300)))
    overlap = bool(close) and float(np.mean(close)) > _MOST_CLOSE
    return JoinedViews(overlap, overlap and float(np.median(scatter)) < _EVEN)
