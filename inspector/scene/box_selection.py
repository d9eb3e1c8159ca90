"""Selection of points by a box that was drawn over the 3D view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray


@dataclass(frozen=True)
class Sight:
    """Camera of a page: its place and attitude in the scene, and how wide it sees."""

    position: Array  # (3,) in the scene's unit
    rotation: Array  # (3, 3) scene_R_camera: x right, y down, z along the view
    fov_rad: float  # from bottom to top
    aspect: float  # width over height

    def on_screen(self, points: Array) -> Array:
        """Places (N, 2) of points (N, 3) on the screen, 0 to 1 from the left top; NaN behind the camera."""
        seen = (np.asarray(points, dtype=float) - self.position) @ self.rotation
        depth = np.where(seen[:, 2] > 0.0, seen[:, 2], np.nan)
        half = np.tan(0.5 * self.fov_rad) * np.array([self.aspect, 1.0])
        return np.asarray(0.5 + 0.5 * seen[:, :2] / depth[:, None] / half)

    def in_box(self, points: Array, corner: tuple[float, float], opposite: tuple[float, float]) -> BoolArray:
        """Whether points (N, 3) are seen in the box between two places on the screen."""
        low, high = np.minimum(corner, opposite), np.maximum(corner, opposite)
        place = self.on_screen(points)
        return np.asarray(((place >= low) & (place <= high)).all(axis=1))
