"""The bend of a printed board, found from its images.

A sheet of paper or a thin plate is bent by some tenths of a millimetre. Its corners then lie at

    z = c_1 x^2 + c_2 x y + c_3 y^2 - their mean     (x, y in halves of the board's longer side)

behind the plane that was printed. That is the same in all images, which see it from many sides, so c is an unknown
beside the lens and the board's poses, by Gauss-Newton with these eliminated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.extras.camera.board import Board
from calib.extras.camera.lens import FREE_NAMES, LENS_NAMES, Lens, by_point
from calib.extras.camera.view import View, ViewPose, view_columns

_SURE = 40.0  # squared errors over the noise that a bend takes away, 3 on average of noise
_LEAST_MM = 0.01  # that is worth counting
_FEWEST_VIEWS = 5


def board_bend(board: Board, lens: Lens, poses: Sequence[ViewPose], sigma_px: float) -> Array | None:
    """Bend (3,) of a board, mm of x^2, x y, y^2, beyond that of the views' corners; None where its images show none.

    The lens is an unknown where it has a covariance, else exact. sigma_px is the pixels' noise.
    """
    if board.is_single or len(poses) < _FEWEST_VIEWS:
        return None
    numbers = np.array(lens.numbers)
    free = [] if lens.covariance is None else [LENS_NAMES.index(name) for name in FREE_NAMES]
    size = len(free) + 3
    information, right = np.zeros((size, size)), np.zeros(size)
    for one in poses:
        view, pose = one.view, one.camera_T_board
        _, columns, by_numbers = view_columns(numbers, pose, view.board_mm)
        by_height = by_point(numbers, view.board_mm @ pose[:3, :3].T + pose[:3, 3]) @ pose[:3, 2]  # (N, 2)
        by_bend = by_height[:, :, None] * _shapes(board, view.board_mm)[:, None, :]
        flat = columns.reshape(-1, 6)
        apart = np.concatenate([by_numbers[:, :, free], by_bend], axis=2).reshape(-1, size)
        apart = apart - flat @ np.linalg.lstsq(flat, apart, rcond=None)[0]
        information += apart.T @ apart
        right += apart.T @ one.error_px.ravel()
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    found, covariance = (inverse @ right)[-3:], inverse[-3:, -3:]
    heights = _shapes(board, board.corners_mm) @ found
    if found @ np.linalg.pinv(covariance, hermitian=True) @ found < _SURE * sigma_px**2 or np.ptp(heights) < _LEAST_MM:
        return None
    return np.asarray(found)


def bent(view: View, board: Board, bend: Array) -> View:
    """A view whose corners lie on a board that is bent further, by (3,) as of `board_bend`."""
    at = view.board_mm.copy()
    at[:, 2] += _shapes(board, at) @ bend
    return replace(view, board_mm=at)


def _shapes(board: Board, board_mm: Array) -> Array:
    """Heights (N, 3) of corners (N, 3) by a bend's three coefficients, 0 on average over the board."""

    def shapes(at: Array) -> Array:
        x, y = at[:, :2].T / (0.5 * max(board.size_mm))
        return np.column_stack([x * x, x * y, y * y])

    return shapes(board_mm) - shapes(board.corners_mm).mean(axis=0)
