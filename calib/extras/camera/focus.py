"""Focal lengths that differ from image to image, as of a camera that focuses anew for each.

With s the share by which an image's focal length is longer than that of all, its pixels are c + (1 + s)(p - c), c the
principal point and p those of the common lens. The board's pose takes most of it up as a distance; by its perspective,
where it is tilted, an image still tells s, which is normal about its mean over the images, a random effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.extras.camera.lens import Lens
from calib.extras.camera.view import View, ViewPose, view_columns

_CLEAR = 9.0  # mean squared sigmas of the images' deviations, 1 of noise
_LEAST = 5e-4  # spread that is worth counting; images blurred by motion seem to differ by half of it
_FEWEST_VIEWS = 5


@dataclass(frozen=True)
class Focus:
    """Deviations of the images' focal lengths from the common one, shares of it."""

    deviation: Mapping[str, float]  # by pose
    sigma: Mapping[str, float]
    spread: float  # standard deviation over the images


def focus_of_views(lens: Lens, poses: Sequence[ViewPose], sigma_px: float, before: Focus | None) -> Focus | None:
    """Focal lengths of views whose pixels are free of what was found before; None where they do not differ clearly."""
    if len(poses) < _FEWEST_VIEWS:
        return None
    numbers = np.array(lens.numbers)
    total, variance = np.zeros(len(poses)), np.zeros(len(poses))
    for k, one in enumerate(poses):
        _, columns, by_numbers = view_columns(numbers, one.camera_T_board, one.view.board_mm)
        flat, longer = columns.reshape(-1, 6), (by_numbers[..., :2] @ numbers[:2]).ravel()
        apart = longer - flat @ np.linalg.lstsq(flat, longer, rcond=None)[0]
        variance[k] = sigma_px**2 / float(apart @ apart)
        total[k] = apart @ one.error_px.ravel() * variance[k] / sigma_px**2
        total[k] += 0.0 if before is None else before.deviation[one.view.pose]
    mean = float(np.average(total, weights=1.0 / variance))
    apart_squared = (total - mean) ** 2
    spread_squared = max(float(np.average(apart_squared - variance, weights=1.0 / variance)), 0.0)
    if before is None and (float(np.mean(apart_squared / variance)) < _CLEAR or spread_squared < _LEAST**2):
        return None
    share = spread_squared / (spread_squared + variance)
    names = [one.view.pose for one in poses]
    return Focus(
        dict(zip(names, (mean + share * (total - mean)).tolist(), strict=True)),
        dict(zip(names, np.sqrt(share * variance).tolist(), strict=True)),
        float(np.sqrt(spread_squared)),
    )


def refocused(views: Sequence[View], lens: Lens, focus: Focus) -> tuple[View, ...]:
    """Views as the common lens would have seen them."""
    middle = np.array(lens.numbers[2:4])
    return tuple(
        replace(view, pixels=middle + (view.pixels - middle) / (1.0 + focus.deviation.get(view.pose, 0.0)))
        for view in views
    )


def focus_errors(lens: Lens, poses: Sequence[ViewPose], focus: Focus) -> Array:
    """Covariance (M, 6, 6), mm and rad, by which uncertain focal lengths of the images add to the board's poses."""
    moved = np.stack([one.by_lens[:, :2] @ np.array(lens.numbers[:2]) * focus.sigma[one.view.pose] for one in poses])
    return np.asarray(moved[:, :, None] * moved[:, None, :])
