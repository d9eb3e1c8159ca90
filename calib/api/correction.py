"""Joint targets with which the real arm goes where the nominal one was sent: `calib.corrected_joints`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from calib.compensation.attitude import FitKnowledge
from calib.compensation.correction import Correction, Corrects
from calib.compensation.target_correction import correction_of
from calib.dataset.dataset import Poses
from calib.fitting.model import Model
from calib.kinematics.robot import Robot
from calib.robot_formats.robots import load_robot


def corrected_joints(
    nominal: Robot | str | Path,
    calibrated: Corrects | Robot | Model,
    q_nominal: ArrayLike,
    *,
    x: ArrayLike | None = None,
    conditions: Poses | None = None,
    kind: str | None = None,
    known: FitKnowledge | None = None,
    ids: Sequence[str] | None = None,
) -> Correction:
    """Joint vectors that give the calibrated arm the tool frame that the nominal arm has with `q_nominal`.

    Args:
        nominal: the robot that the controller computes with, its file or name; its joint limits hold.
        calibrated: a calibration, a diagnosis, a model from a file, a robot, or a `Model` with x.
        q_nominal: (N, n) rad, mm for prismatic joints.
        x: (P,) fitted parameters of a `Model`.
        conditions: payload, temperature ... of each target, for effects that depend on them; its own q is not used.
        kind: "pose" (position and orientation of the tool frame) or "position" alone; None: a pose for six joints and
            more, unless the attitude's sigma is not better than the turn that the correction would make.
        known: covariance and ranges of the fit, for a `Model` or a robot; None: it is taken as exact.
        ids: names of the targets, for messages.

    Raises:
        FitError: joint vectors of the wrong shape or not finite, arms that differ in their joints, or a `Model`
            without x.

    >>> import calib
    >>> fit = calib.calibrate("sample_data/hidden_effect_a")
    >>> calib.corrected_joints(fit.dataset.robot, fit, fit.dataset.poses.q[:5])
    Correction(RB5-850: 5 of 5 targets reached (position))
    """
    return correction_of(
        load_robot(nominal), calibrated, q_nominal, x=x, conditions=conditions, kind=kind, known=known, ids=ids
    )
