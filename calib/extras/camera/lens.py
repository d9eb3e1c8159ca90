"""The lens: a pinhole with the distortion of Brown and Conrady, as OpenCV and ROS (`plumb_bob`, rational) have it.

A point (X, Y, Z) of the camera's frame (z along the sight, x to the right, y down) is seen at

    x = X / Z, y = Y / Z, r^2 = x^2 + y^2, g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    u = fx (g x + 2 p1 x y + p2 (r^2 + 2 x^2)) + cx
    v = fy (g y + p1 (r^2 + 2 y^2) + 2 p2 x y) + cy

in pixels, the middle of the first pixel being (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.errors import CalibError

LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Names of the lens's numbers, the first four in pixels, in OpenCV's order of distortion."""
FREE_NAMES = LENS_NAMES[:9]
"""Those that are found where a lens is found from images: OpenCV's own choice."""


@dataclass(frozen=True)
class Lens(Brief):
    """A camera's lens: image size, focal lengths, principal point and distortion; with covariance where it is known."""

    width_px: int
    height_px: int
    numbers: tuple[float, ...]  # (12,) in the order of LENS_NAMES
    covariance: Array | None = None  # (12, 12) of the numbers' errors; zero for those that were not found

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the image, pixels."""
        return self.width_px, self.height_px

    @property
    def matrix(self) -> Array:
        """Camera matrix (3, 3), pixels."""
        fx, fy, cx, cy = self.numbers[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """Distortion (8,) in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6."""
        return np.array(self.numbers[4:])

    @property
    def sigmas(self) -> Array:
        """Standard deviations (12,) of the numbers; zero where they are taken as exact."""
        return np.zeros(len(LENS_NAMES)) if self.covariance is None else np.sqrt(np.diag(self.covariance))

    def _brief(self) -> str:
        fx, fy, cx, cy = self.numbers[:4]
        return f"{self.width_px} x {self.height_px} pixels, f {fx:.1f} {fy:.1f}, centre {cx:.1f} {cy:.1f}"


def opencv() -> ModuleType:
    """OpenCV. Raises CalibError where the extra is not installed."""
    try:
        import cv2
    except ImportError:
        raise CalibError(
            "images need OpenCV, which is not installed: pip install 'robot-calibration-inspector[camera]'"
        ) from None
    return cv2


def project(lens: Lens, camera_mm: Array) -> Array:
    """Pixels (..., 2) at which points (..., 3) of the camera's frame are seen."""
    there = np.zeros(3)
    seen = opencv().projectPoints(camera_mm.reshape(-1, 1, 3), there, there, lens.matrix, lens.distortion)[0]
    return np.asarray(seen.reshape(*camera_mm.shape[:-1], 2))
