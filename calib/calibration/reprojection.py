"""Reprojection of a fit: where fitted arm, camera and board put the corners in each image, beside where they are seen.

A lens that was found from the images is an unknown of the fit. Its numbers are then those with the least squared errors
of the fitted images' corners, the board being where arm, camera's and board's place put it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.camera.lens import FREE_NAMES, LENS_NAMES, by_lens, project
from calib.camera.view import View
from calib.fitting.observations import Observations, predict_poses, with_nominal_scanner_frames
from calib.fitting.pose_residuals import PoseResiduals

_ROUNDS = 6


@dataclass(frozen=True)
class ReprojectedView(Brief):
    """Corners of one image, and where the fit puts them."""

    view: View
    role: str  # of the pose
    predicted: Array  # (N, 2) pixels

    @property
    def error_px(self) -> Array:
        """Seen minus predicted corners (N, 2), pixels."""
        return self.view.pixels - self.predicted

    @property
    def rms_px(self) -> float:
        """Root mean square of one coordinate's error, pixels."""
        return float(np.sqrt(np.mean(self.error_px**2)))


@lru_cache(maxsize=4)  # text, document and figures of one fit ask for it in turn
def reprojected_views(calibration: Calibration) -> tuple[ReprojectedView, ...]:
    """Views of all measured poses, test poses too; empty where no images of a board were fitted as full poses.

    Camera and board are where the training poses put them; so is a lens that was found from the images.
    """
    dataset = calibration.dataset
    if dataset.camera is None or calibration.residual != "pose":
        return ()
    model, x = calibration.model, calibration.fit.x
    training, residuals = _fitted_residuals(calibration)
    placed = residuals.frames_and_hand_eye(x)
    everything = Observations.of(dataset, np.isin(dataset.poses.setup, list(placed.scanner_T_base)))
    everything = replace(everything, scanner_T_base=training.scanner_T_base)
    residuals = PoseResiduals(model, everything)
    errors = residuals.errors(placed, *predict_poses(model, x, everything))
    points = everything.points
    assert points.orientations is not None
    turns = frames.rotation_from_rotvec(errors[:, 3:]) @ points.orientations.scanner_R_jig
    seen = []
    for pose, place_mm, turn in zip(points.pose, points.xyz_mm + errors[:, :3], turns, strict=True):
        view = dataset.camera.of(dataset.poses.ids[pose])
        if view is not None and np.isfinite(turn).all():
            seen.append((view, str(dataset.poses.role[pose]), view.board_mm @ turn.T + place_mm))
    numbers = np.array(dataset.camera.lens.numbers)
    fitted = [(view.pixels, camera_mm) for view, role, camera_mm in seen if role != "test"]
    if dataset.camera.lens_from == "images" and fitted:
        numbers = _refitted(numbers, *map(np.concatenate, zip(*fitted, strict=True)))
    return tuple(ReprojectedView(view, role, project(numbers, camera_mm)) for view, role, camera_mm in seen)


def _fitted_residuals(calibration: Calibration) -> tuple[Observations, PoseResiduals]:
    model = calibration.model
    training = with_nominal_scanner_frames(Observations.of(calibration.fitted_dataset), model.placed_robot)
    return training, PoseResiduals(model, training)


def full_pose_errors(calibration: Calibration) -> Array:
    """Errors (M, 6) at the poses of a fit of full poses, predicted minus measured: mm, and rotation vectors in rad."""
    training, residuals = _fitted_residuals(calibration)
    x = calibration.fit.x
    return residuals.errors(residuals.frames_and_hand_eye(x), *predict_poses(calibration.model, x, training))


def _refitted(numbers: Array, pixels: Array, camera_mm: Array) -> Array:
    """Lens numbers (12,) with the least squared errors of corners (N, 2) at known places (N, 3) before the camera."""
    free = [LENS_NAMES.index(name) for name in FREE_NAMES]
    numbers = numbers.copy()
    for _ in range(_ROUNDS):
        columns = by_lens(numbers, camera_mm).reshape(-1, len(numbers))[:, free]
        scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        left = (pixels - project(numbers, camera_mm)).ravel()
        numbers[free] += np.linalg.lstsq(columns / scale, left, rcond=1e-9)[0] / scale
    return numbers


def rms_px(views: tuple[ReprojectedView, ...]) -> float | None:
    """Root mean square of one coordinate over all corners of some views, pixels; None where there are none."""
    if not views:
        return None
    return float(np.sqrt(np.mean(np.concatenate([one.error_px for one in views]) ** 2)))
