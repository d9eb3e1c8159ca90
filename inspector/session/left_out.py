"""A pose left out of a session, and taken in again: the same model, fitted to the poses that count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.dataset.repeats import in_repeat_groups_of
from calib.diagnosis.effect_selection import FitStep
from calib.errors import CalibError
from inspector.session.session import Session
from inspector.session.transitions import search_space, with_steps

LEFT_OUT, TAKEN_IN = "− pose ", "+ pose "  # labels of the steps, before the pose's id


def with_pose_left_out(session: Session, pose_id: str) -> Session:
    """Leave a pose out, as training and as test pose, and fit the same model to the others.

    Raises CalibError for an unknown pose, one that is left out already, and where the others are too few to fit.
    """
    session.dataset.poses.index(pose_id)
    if pose_id in session.uncounted:
        raise CalibError(f"pose {pose_id} is left out already")
    return _fitted_again(replace(session, left_out=(*session.left_out, pose_id)), f"{LEFT_OUT}{pose_id}")


def with_pose_taken_in(session: Session, pose_id: str) -> Session:
    """Take a pose in again, which was left out as asked or because it stood out, and fit the same model with it.

    Raises CalibError for an unknown pose and one that is not left out.
    """
    session.dataset.poses.index(pose_id)
    if pose_id not in session.uncounted:
        raise CalibError(f"pose {pose_id} is not left out")
    if pose_id in session.dataset.left_out:
        raise CalibError(f"pose {pose_id} was left out when the dataset was loaded; load it with the pose")
    kept = tuple(other for other in session.left_out if other != pose_id)
    return _fitted_again(replace(session, left_out=kept), f"{TAKEN_IN}{pose_id}", pose_id)


def _fitted_again(session: Session, label: str, taken_in: str = "") -> Session:
    """The model of the last step fitted to the poses that count now; nothing to fit before the first calibration."""
    if session.calibration is None:
        return replace(session, redundancy=None)
    last = session.steps[-1]
    # Repeats of one pose are outliers together, and are taken in together.
    alone = {taken_in} if taken_in else set()
    if taken_in and last.left_out:
        ids, of_stand = session.dataset.poses.ids, in_repeat_groups_of(session.dataset, [taken_in])
        alone = {ids[i] for i in np.flatnonzero(of_stand)}
    gone = alone | set(session.left_out)
    stand_out = tuple(pose_id for pose_id in last.left_out if pose_id not in gone)
    space = search_space(session).without(stand_out)
    step = FitStep(label, last.selected, space.fit(last.selected, None), left_out=stand_out)
    return replace(with_steps(session, (*session.steps, step)), redundancy=None)
