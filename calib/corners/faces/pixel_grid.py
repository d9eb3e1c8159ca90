"""The grid of a scanner's pixels, from the directions in which it sees the points of a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from calib.array_types import Array

_POINTS = 2_000  # that lie side by side are enough


@dataclass(frozen=True)
class PixelGrid:
    """The pixels' directions near the jig: square, of one pitch."""

    steps: Array  # (2, 3) from pixel to pixel, rad; across the line of sight

    @property
    def pitch_rad(self) -> float:
        """From pixel to pixel."""
        return float(np.linalg.norm(self.steps[0]))


def pixel_grid(seen_mm: Array, middle_mm: Array) -> PixelGrid | None:
    """The pixels' grid, from a surface's points (N, 3) around its middle (3,), in the scanner's frame; None of too few.

    Where the points lie on no square grid any direction does: the shares are then a mean over directions.
    """
    if len(seen_mm) > _POINTS:
        away = np.sum((seen_mm - middle_mm) ** 2, axis=1)
        seen_mm = seen_mm[np.argpartition(away, _POINTS)[:_POINTS]]
    if len(seen_mm) < 2:
        return None
    ways = seen_mm / np.linalg.norm(seen_mm, axis=1)[:, None]
    across = np.linalg.svd(ways.mean(axis=0)[None])[2][1:]
    seen_at = ways @ across.T
    tree = cKDTree(seen_at, balanced_tree=False, compact_nodes=False)
    distance, nearest = (np.asarray(found) for found in tree.query(seen_at, k=2))
    pitch_rad = float(np.median(distance[:, 1]))
    if not pitch_rad > 0:
        return None
    usual = np.abs(distance[:, 1] - pitch_rad) < 0.2 * pitch_rad
    x, y = (seen_at[nearest[:, 1]] - seen_at)[usual].T
    quarter = np.angle(np.sum(((x + 1j * y) / np.hypot(x, y)) ** 4)) / 4  # a quarter turn leaves a square grid as it is
    turn = np.array([[np.cos(quarter), np.sin(quarter)], [-np.sin(quarter), np.cos(quarter)]])
    return PixelGrid(pitch_rad * turn @ across)
