"""Views: the corners of a board that an image shows, and the board's pose from them, with its covariance.

With the board's pose in the camera's frame as a shift d of its middle and a small turn w about it (axes of the camera),
whitened pixel errors are e = J (d, w) + L n + noise, n the lens's error. The pose by least squares has the covariance
C = (J'J)^-1 at a known lens, and moves by G n = -(J'J)^-1 J'L n with the lens, which is the same for all views: poses
of several views are correlated through it. To first order the pixels say no more of arm and mount than C and G do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.brief import Brief
from calib.errors import CalibError
from calib.extras.camera.lens import FREE_NAMES, LENS_NAMES, Lens, by_lens, by_point, project
from calib.statistics import covariance_root

_STEPS = 60
_SETTLED = 1e-10
_ROUNDS = 40
_LEAST_SHARE = 1e-13  # of a lens combination's information, below which the views do not determine it


@dataclass(frozen=True)
class View(Brief):
    """Corners of the board in one image."""

    pose: str
    corner: IndexArray  # (N,) number of each corner on the board
    board_mm: Array  # (N, 3) in the board's frame, about the middle of the whole board
    pixels: Array  # (N, 2)

    def _brief(self) -> str:
        return f"{self.pose}: {len(self.corner)} corners"


@dataclass(frozen=True)
class ViewPose:
    """Pose of the board's middle in one view, in the camera's frame."""

    view: View
    camera_T_board: Array  # (4, 4) mm
    information: Array  # (6, 6) J'J of shift, mm, and turn, rad, per squared pixel of noise
    by_lens: Array  # (6, 12) by which shift and turn move with the lens's numbers
    error_px: Array  # (N, 2) seen minus predicted

    @property
    def squares(self) -> float:
        """Sum of the squared errors, squared pixels."""
        return float(np.sum(self.error_px**2))


def pose_columns(numbers: Array, camera_T_board: Array, board_mm: Array) -> tuple[Array, Array]:
    """Predicted pixels (N, 2), and derivatives by the board's shift and turn (N, 2, 6)."""
    about_mm = board_mm @ camera_T_board[:3, :3].T
    camera_mm = about_mm + camera_T_board[:3, 3]
    return project(numbers, camera_mm), by_point(numbers, camera_mm) @ frames.frame_motion(about_mm, np.zeros(3))


def view_columns(numbers: Array, camera_T_board: Array, board_mm: Array) -> tuple[Array, Array, Array]:
    """Predicted pixels (N, 2), and derivatives by the board's shift and turn (N, 2, 6) and by the lens (N, 2, 12)."""
    predicted, pose = pose_columns(numbers, camera_T_board, board_mm)
    return predicted, pose, by_lens(numbers, board_mm @ camera_T_board[:3, :3].T + camera_T_board[:3, 3])


def moved(camera_T_board: Array, motion: Array) -> Array:
    """Pose (4, 4) of a board that is shifted and turned about its own middle by a motion (6,), mm and rad."""
    turn = frames.rotation_from_rotvec(motion[3:])
    return frames.make_transform(turn @ camera_T_board[:3, :3], camera_T_board[:3, 3] + motion[:3])


def pose_of_view(numbers: Array, view: View, start: Array) -> ViewPose:
    """Pose of the board with the least squared pixel errors, by damped Gauss-Newton from a start (4, 4)."""
    at, damping = start, 1e-6
    predicted, columns = pose_columns(numbers, at, view.board_mm)
    error = view.pixels - predicted
    for _ in range(_STEPS):
        flat = columns.reshape(-1, 6)
        square = flat.T @ flat
        scale = np.sqrt(np.diag(square))
        shaped = square / np.outer(scale, scale) + damping * np.eye(6)
        step = np.linalg.solve(shaped, flat.T @ error.ravel() / scale) / scale
        trial = moved(at, step)
        if np.all((view.board_mm @ trial[:3, :3].T + trial[:3, 3])[:, 2] > 0.0):
            seen, changed = pose_columns(numbers, trial, view.board_mm)
            if np.sum((view.pixels - seen) ** 2) <= np.sum(error**2) * (1.0 + 1e-12):
                at, error, columns, damping = trial, view.pixels - seen, changed, damping * 0.1
                if np.max(np.abs(step * scale)) < _SETTLED * (1.0 + float(np.linalg.norm(error))):
                    break
                continue
        damping = max(damping, 1e-9) * 10.0
        if damping > 1e6:
            break
    flat, lens = columns.reshape(-1, 6), view_columns(numbers, at, view.board_mm)[2].reshape(-1, len(numbers))
    square = flat.T @ flat
    return ViewPose(view, at, square, np.asarray(-np.linalg.solve(square, flat.T @ lens), np.float64), error)


def noise_px(poses: Sequence[ViewPose], found: int = 0) -> float:
    """Standard deviation of one pixel coordinate, from what the views' own poses leave; `found` lens numbers."""
    left = sum(2 * len(one.view.corner) - 6 for one in poses) - found
    if left <= 0:
        raise CalibError("the views show too few corners to tell the pixels' noise; show more of the board")
    return float(np.sqrt(sum(one.squares for one in poses) / left))


@dataclass(frozen=True)
class FoundLens:
    """A lens found from views, with the board's pose in each."""

    lens: Lens
    poses: tuple[ViewPose, ...]
    sigma_px: float


def found_lens(start: Lens, poses: Sequence[ViewPose]) -> FoundLens:
    """Lens and board poses with the least squared pixel errors of all views, and the lens's covariance.

    Raises CalibError where the views do not determine the lens.
    """
    free = [LENS_NAMES.index(name) for name in FREE_NAMES]
    numbers = np.array(start.numbers)
    poses = list(poses)
    for _ in range(_ROUNDS):
        information, right = lens_equations(numbers, poses, free)
        scale = np.sqrt(np.diag(information))
        if not np.all(scale > 0.0):
            raise CalibError("the images do not tell the lens; give it by --intrinsics")
        shaped = information / np.outer(scale, scale)
        if np.linalg.eigvalsh(shaped)[0] < _LEAST_SHARE:
            raise CalibError(
                f"the {len(poses)} images do not tell the lens: the board is seen from too few sides; tilt it or the "
                "camera by 30 deg and more in several directions, or give --intrinsics"
            )
        step = np.linalg.solve(shaped, right / scale) / scale
        numbers[free] += step
        poses = [pose_of_view(numbers, one.view, one.camera_T_board) for one in poses]
        if np.max(np.abs(step * scale)) < 1e-7 * (1.0 + np.sqrt(sum(one.squares for one in poses))):
            break
    sigma_px = noise_px(poses, len(free))
    covariance = np.zeros((len(numbers), len(numbers)))
    covariance[np.ix_(free, free)] = sigma_px**2 * np.linalg.inv(shaped) / np.outer(scale, scale)
    lens = replace(start, numbers=tuple(map(float, numbers)), covariance=covariance)
    return FoundLens(lens, tuple(poses), sigma_px)


def lens_equations(numbers: Array, poses: Sequence[ViewPose], free: Sequence[int]) -> tuple[Array, Array]:
    """Normal equations (K, K), (K,) of some of a lens's numbers, the poses of the views eliminated, squared pixels."""
    information, right = np.zeros((len(free), len(free))), np.zeros(len(free))
    for one in poses:
        _, columns, by_numbers = view_columns(numbers, one.camera_T_board, one.view.board_mm)
        flat, by_free = columns.reshape(-1, 6), by_numbers.reshape(-1, len(numbers))[:, list(free)]
        apart = by_free - flat @ np.linalg.lstsq(flat, by_free, rcond=None)[0]
        information += apart.T @ apart
        right += apart.T @ one.error_px.ravel()
    return information, right


def covariance_of(pose: ViewPose, sigma_px: float) -> Array:
    """Covariance (6, 6), mm and rad, of the board's shift and turn at a known lens."""
    scale = np.sqrt(np.diag(pose.information))
    inverse = np.linalg.inv(pose.information / np.outer(scale, scale))
    covariance = sigma_px**2 * inverse / np.outer(scale, scale)
    return np.asarray(0.5 * (covariance + covariance.T))


def shared_errors(lens: Lens, poses: Sequence[ViewPose], board_sigma: float = 0.0) -> Array:
    """Changes (M, 6, K), mm and rad, of the board's poses by one sigma of each of K errors that all of them share.

    They are the independent errors of the lens, unless it is taken as exact, and that of the board's size, with which
    every place grows; `board_sigma` is a share of the size. Combinations of no influence are left out.
    """
    changes: Array = np.zeros((len(poses), 6, 0))
    if lens.covariance is not None and np.any(lens.covariance):
        used = np.flatnonzero(np.diag(lens.covariance) > 0.0)
        root = covariance_root(lens.covariance[np.ix_(used, used)])
        changes = np.stack([one.by_lens[:, used] @ root for one in poses])
    if board_sigma > 0.0:
        place = np.stack([one.camera_T_board[:3, 3] for one in poses])
        grown = board_sigma * np.concatenate([place, np.zeros_like(place)], axis=1)
        changes = np.concatenate([changes, grown[:, :, None]], axis=2)
    return changes
