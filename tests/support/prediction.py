"""The covariance of a predicted point, computed beside what the promise computes of it."""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.dataset import Poses
from calib.fitting.observations import Observations
from calib.statistics import covariance_root


def prediction_covariance(calibration: Calibration, poses: Poses, setup: str | None = None) -> Array:
    """Covariance (N, 3, 3), mm^2, of the predicted tool point at N poses, in a setup's scanner frame.

    Where the arm carries the scanner it is that of the (first) target in the room. The parameters and the frame that
    was fitted with them are both uncertain, and correlated (`JointKnowledge`): cov = [J G] cov(x, frame) [J G]^T with J
    and G the columns of parameters and frame at the predicted point. `setup`: whose frame; the first where None.
    """
    observed = Observations.of(calibration.fitted_dataset)
    name = str(observed.setup[0]) if setup is None else setup
    known = JointKnowledge.of(calibration, name)
    scanner_T_base = calibration.after.scanner_T_base[name]
    target = observed.first_target if calibration.model.robot.carries_scanner else "jig"
    points_mm, by_q = calibration.model.linearise(calibration.fit.x, poses, target)
    motion = frames.frame_motion(frames.apply(scanner_T_base, points_mm), known.centre_mm)
    rows = np.concatenate([scanner_T_base[:3, :3] @ by_q, motion], axis=-1)
    spread = rows @ covariance_root(known.covariance)
    return spread @ np.swapaxes(spread, 1, 2)
