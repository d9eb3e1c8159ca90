"""Errors of a model at the measured orientations of the jig, rad."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset
from calib.fitting.model import Model
from calib.fitting.observations import Observations, predict_poses, with_nominal_scanner_frames
from calib.fitting.pose_residuals import PoseResiduals
from calib.statistics import rms


@dataclass(frozen=True)
class OrientationFigures:
    """Statistics, rad, of the angle between predicted and measured orientation of the jig over some poses."""

    poses: int
    rmse_rad: float
    max_rad: float


@dataclass(frozen=True)
class OrientationErrors:
    """Errors of the jig's orientation at training and test poses; frames are fitted to training poses alone."""

    train: OrientationFigures | None
    test: OrientationFigures | None


def residuals_of_all_poses(model: Model, x: Array, fitted: Dataset, dataset: Dataset) -> tuple[PoseResiduals, Array]:
    """Residuals of a dataset's poses, test poses too, and errors (M, 6), by frames of the poses that were fitted."""
    training = with_nominal_scanner_frames(Observations.of(fitted), model.placed_robot)  # as the fit had it
    placed = PoseResiduals(model, training).frames_and_hand_eye(x)
    everything = Observations.of(dataset, np.isin(dataset.poses.setup, list(placed.scanner_T_base)))
    residuals = PoseResiduals(model, replace(everything, scanner_T_base=training.scanner_T_base))
    return residuals, residuals.errors(placed, *predict_poses(model, x, residuals.observed))


def evaluate_orientations(model: Model, x: Array, dataset: Dataset) -> OrientationErrors:
    """Errors of the jig's orientation at parameters x (P,); setups without training poses are left out.

    Raises FitError where no training pose has an orientation, or orientations have no covariance.
    """
    residuals, errors = residuals_of_all_poses(model, x, dataset, dataset)
    angle = np.linalg.norm(errors[:, 3:], axis=1)
    is_test = dataset.poses.is_test[residuals.observed.points.pose]

    def figures(rows: BoolArray) -> OrientationFigures | None:
        off = angle[rows & residuals.has_orientation]
        if len(off) == 0:
            return None
        return OrientationFigures(len(off), rms(off), float(off.max()))

    return OrientationErrors(figures(~is_test), figures(is_test))
