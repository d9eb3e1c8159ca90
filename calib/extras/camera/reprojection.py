"""Reprojection of a fit: where fitted arm, camera and board put the corners in each image, beside where they are seen.

A lens that was found from the images is an unknown of the fit, and so may the board's size be. What the fit finds of
them moves the board to where the declared lens and size show it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.orientation_errors import residuals_of_all_poses
from calib.calibration.result import Calibration
from calib.extras.camera.lens import project
from calib.extras.camera.observed import camera_of
from calib.extras.camera.view import View
from calib.statistics import rms


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
        return rms(self.error_px)


@lru_cache(maxsize=4)  # text, document and figures of one fit ask for it in turn
def reprojected_views(calibration: Calibration) -> tuple[ReprojectedView, ...]:
    """Views of all measured poses, test poses too; empty where no images of a board were fitted as full poses.

    Camera and board are where the training poses put them, and so is what else the fit finds of lens and board.
    """
    dataset, camera = calibration.dataset, camera_of(calibration.dataset)
    if camera is None or calibration.residual != "pose":
        return ()
    model, x = calibration.model, calibration.fit.x
    residuals, errors = residuals_of_all_poses(model, x, calibration.fitted_dataset, dataset)
    points = residuals.observed.points.free_of(None)
    assert points.orientations is not None
    turns = frames.rotation_from_rotvec(errors[:, 3:]) @ points.orientations.scanner_R_jig
    seen = []
    for pose, place_mm, turn in zip(points.pose, points.xyz_mm + errors[:, :3], turns, strict=True):
        view = camera.of(dataset.poses.ids[pose])
        if view is not None and np.isfinite(turn).all():
            seen.append((view, str(dataset.poses.role[pose]), view.board_mm @ turn.T + place_mm))
    return tuple(ReprojectedView(view, role, project(camera.lens, camera_mm)) for view, role, camera_mm in seen)


def rms_px(views: tuple[ReprojectedView, ...]) -> float | None:
    """Root mean square of one coordinate over all corners of some views, pixels; None where there are none."""
    if not views:
        return None
    return rms(np.concatenate([one.error_px for one in views]))
