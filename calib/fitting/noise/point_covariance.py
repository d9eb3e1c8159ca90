"""The covariances of measured points under a shape of the noise."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.noise_shape import NoiseShape


def noise_factors(shape: NoiseShape, xyz_mm: Array) -> Array:
    """(M, 3, 3) by which the declared noise of points (M, 3) is multiplied, scanner frame."""
    size, sight = _size_and_sight(shape, xyz_mm)
    along = np.eye(3) + (shape.depth - 1.0) * sight[:, :, None] * sight[:, None, :]
    return np.asarray(size[:, None, None] * (np.array(shape.axes) @ along))


def inverse_factors(shape: NoiseShape, xyz_mm: Array) -> tuple[Array, float]:
    """The inverses (M, 3, 3) of `noise_factors`, and the sum of the logs of these' determinants."""
    size, sight = _size_and_sight(shape, xyz_mm)
    along = np.eye(3) + (1.0 / shape.depth - 1.0) * sight[:, :, None] * sight[:, None, :]
    axes = np.array(shape.axes)
    log_axes = float(np.log(abs(np.linalg.det(axes)) * abs(shape.depth)))
    inverse = (along @ np.linalg.inv(axes)) / size[:, None, None]
    return np.asarray(inverse), float(3.0 * np.sum(np.log(size))) + len(size) * log_axes


def _size_and_sight(shape: NoiseShape, xyz_mm: Array) -> tuple[Array, Array]:
    distance_mm = np.linalg.norm(xyz_mm, axis=1)
    size = shape.scale * np.exp(shape.growth_per_m * 1e-3 * (distance_mm - shape.distance_mm))
    return size, xyz_mm / np.maximum(distance_mm, 1e-9)[:, None]


def shaped_covariance(factors: Array, covariance_mm2: Array) -> Array:
    """The covariances (M, 3, 3) under such factors (M, 3, 3), from those that were declared."""
    return np.asarray(factors @ covariance_mm2 @ np.swapaxes(factors, 1, 2))
