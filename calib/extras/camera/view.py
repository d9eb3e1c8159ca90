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
from calib.array_types import Array, BoolArray, IndexArray
from calib.brief import Brief
from calib.errors import CalibError
from calib.extras.camera.lens import FREE_NAMES, LENS_NAMES, Lens, opencv
from calib.statistics import covariance_root

_SETTLED = (3, 200, 1e-14)  # of OpenCV's searches: at most so many rounds, and the relative change that ends them
_LEAST_SHARE = 1e-13  # of a lens combination's information, below which the views do not determine it


@dataclass(frozen=True)
class View(Brief):
    """Corners of the board in one image."""

    pose: str
    corner: IndexArray  # (N,) number of each corner on the board
    board_mm: Array  # (N, 3) in the board's frame, about the middle of the whole board
    pixels: Array  # (N, 2)

    def select(self, rows: BoolArray) -> View:
        """Some of its corners."""
        return replace(self, corner=self.corner[rows], board_mm=self.board_mm[rows], pixels=self.pixels[rows])

    def _brief(self) -> str:
        return f"{self.pose}: {len(self.corner)} corners"


@dataclass(frozen=True)
class ViewPose:
    """Pose of the board's middle in one view, in the camera's frame."""

    view: View
    camera_T_board: Array  # (4, 4) mm
    error_px: Array  # (N, 2) seen minus predicted
    pixels_by_pose: Array  # (2 N, 6) derivative by shift, mm, and turn, rad, along and about the camera's axes
    pixels_by_lens: Array  # (2 N, 12)

    @property
    def information(self) -> Array:
        """J'J (6, 6) of shift and turn, per squared pixel of noise."""
        return self.pixels_by_pose.T @ self.pixels_by_pose

    @property
    def by_lens(self) -> Array:
        """By which shift and turn move with the lens's numbers, (6, 12)."""
        return np.asarray(-np.linalg.solve(self.information, self.pixels_by_pose.T @ self.pixels_by_lens))

    @property
    def squares(self) -> float:
        """Sum of the squared errors, squared pixels."""
        return float(np.sum(self.error_px**2))


def pose_of_view(lens: Lens, view: View, start: Array) -> ViewPose:
    """Pose of the board with the least squared pixel errors, from a start (4, 4)."""
    cv2 = opencv()
    camera = lens.matrix, lens.distortion
    first = frames.rotvec_from_rotation(start[:3, :3]), start[:3, 3].copy()
    turn, shift = cv2.solvePnPRefineLM(view.board_mm, view.pixels, *camera, *first, _SETTLED)
    at = frames.make_transform(frames.rotation_from_rotvec(turn.ravel()), shift.ravel())
    # Of the board as it is turned already: then OpenCV's derivative by a turn is that by a small one.
    predicted, columns = cv2.projectPoints(view.board_mm @ at[:3, :3].T, np.zeros(3), shift, *camera)
    error_px = view.pixels - predicted.reshape(-1, 2)
    return ViewPose(view, at, error_px, columns[:, [3, 4, 5, 0, 1, 2]], columns[:, 6:])


def noise_px(poses: Sequence[ViewPose], found: int = 0) -> float:
    """Standard deviation of one pixel coordinate, from what the views' own poses leave; `found` lens numbers."""
    left = sum(2 * len(one.view.corner) - 6 for one in poses) - found
    if left <= 0:
        raise CalibError("the views show too few corners to tell the pixels' noise; show more of the board")
    return float(np.sqrt(sum(one.squares for one in poses) / left))


def found_lens(views: Sequence[View], size_px: tuple[int, int]) -> Lens:
    """Lens, by OpenCV, with the least squared pixel errors of views of a board, and its covariance.

    Raises CalibError where the views do not determine the lens.
    """
    cv2 = opencv()
    corners = [
        [part.astype(np.float32) for part in parts]
        for parts in zip(*((v.board_mm, v.pixels) for v in views), strict=True)
    ]
    try:
        found = cv2.calibrateCamera(*corners, size_px, None, None, criteria=_SETTLED)
    except cv2.error as error:
        raise CalibError(f"OpenCV finds no lens from the images: {str(error).splitlines()[-1].strip()}") from None
    _, matrix, distortion, turns, shifts = found
    free = [LENS_NAMES.index(name) for name in FREE_NAMES]
    numbers = np.zeros(len(LENS_NAMES))
    numbers[free] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(distortion)[:5]
    lens = Lens(*size_px, tuple(map(float, numbers)))
    starts = (
        frames.make_transform(cv2.Rodrigues(turn)[0], shift.ravel()) for turn, shift in zip(turns, shifts, strict=True)
    )
    poses = [pose_of_view(lens, view, start) for view, start in zip(views, starts, strict=True)]
    information = lens_information(poses, free)
    scale = np.sqrt(np.diag(information))
    shaped = information / np.outer(scale, scale)
    if not np.linalg.eigvalsh(shaped)[0] > _LEAST_SHARE:
        raise CalibError(
            f"the {len(views)} images do not tell the lens: the board is seen from too few sides; tilt it or the "
            "camera by 30 deg and more in several directions, or give --intrinsics"
        )
    covariance = np.zeros((len(numbers), len(numbers)))
    covariance[np.ix_(free, free)] = noise_px(poses, len(free)) ** 2 * np.linalg.inv(shaped) / np.outer(scale, scale)
    return replace(lens, covariance=covariance)


def lens_information(poses: Sequence[ViewPose], free: Sequence[int]) -> Array:
    """Information (K, K) on some of a lens's numbers, the poses of the views eliminated, per squared pixel of noise."""
    information = np.zeros((len(free), len(free)))
    for one in poses:
        flat, by_free = one.pixels_by_pose, one.pixels_by_lens[:, list(free)]
        apart = by_free - flat @ np.linalg.lstsq(flat, by_free, rcond=None)[0]
        information += apart.T @ apart
    return information


def covariance_of(pose: ViewPose, sigma_px: float) -> Array:
    """Covariance (6, 6), mm and rad, of the board's shift and turn at a known lens."""
    scale = np.sqrt(np.diag(pose.information))
    inverse = np.linalg.inv(pose.information / np.outer(scale, scale))
    covariance = sigma_px**2 * inverse / np.outer(scale, scale)
    return np.asarray(0.5 * (covariance + covariance.T))


def shared_errors(lens: Lens, poses: Sequence[ViewPose]) -> Array:
    """Changes (M, 6, K), mm and rad, of the board's poses by one sigma of each independent error of the lens.

    All poses share them; there are none of a lens that is taken as exact.
    """
    if lens.covariance is None or not np.any(lens.covariance):
        return np.zeros((len(poses), 6, 0))
    used = np.flatnonzero(np.diag(lens.covariance) > 0.0)
    root = covariance_root(lens.covariance[np.ix_(used, used)])
    return np.stack([one.by_lens[:, used] @ root for one in poses])
