"""The lens: a pinhole with the distortion of Brown and Conrady, as OpenCV and ROS (`plumb_bob`, rational) have it.

A point (X, Y, Z) of the camera's frame (z along the sight, x to the right, y down) is seen at

    x = X / Z, y = Y / Z, r^2 = x^2 + y^2, g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    u = fx (g x + 2 p1 x y + p2 (r^2 + 2 x^2)) + cx
    v = fy (g y + p1 (r^2 + 2 y^2) + 2 p2 x y) + cy

in pixels, the middle of the first pixel being (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief

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


def project(numbers: Array, camera_mm: Array) -> Array:
    """Pixels (..., 2) at which points (..., 3) of the camera's frame are seen; numbers (12,) are the lens's."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6 = numbers
    x = camera_mm[..., 0] / camera_mm[..., 2]
    y = camera_mm[..., 1] / camera_mm[..., 2]
    square = x * x + y * y
    g = (1.0 + square * (k1 + square * (k2 + square * k3))) / (1.0 + square * (k4 + square * (k5 + square * k6)))
    u = g * x + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    v = g * y + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([fx * u + cx, fy * v + cy], axis=-1)


def by_point(numbers: Array, camera_mm: Array) -> Array:
    """Derivative (..., 2, 3) of the pixels by the point, pixels per mm, by differences at 1e-6 of its distance."""
    step = 1e-6 * np.linalg.norm(camera_mm, axis=-1)[..., None]
    columns = [
        (project(numbers, camera_mm + step * axis) - project(numbers, camera_mm - step * axis)) / (2.0 * step)
        for axis in np.eye(3)
    ]
    return np.stack(columns, axis=-1)


def by_lens(numbers: Array, camera_mm: Array) -> Array:
    """Derivative (..., 2, 12) of the pixels by the lens's numbers, by differences."""
    columns = []
    for k, number in enumerate(numbers):
        step = np.zeros(len(numbers))
        step[k] = 1e-5 * max(abs(number), 1.0)
        change = project(numbers + step, camera_mm) - project(numbers - step, camera_mm)
        columns.append(change / (2.0 * step[k]))
    return np.stack(columns, axis=-1)
