"""A cause as one says it: which joint, how large, and at which pose it moves the tool the most."""

from __future__ import annotations

import numpy as np

from calib.calibration.result import Calibration
from calib.diagnosis.words.conclusions import AtPose, Cause
from calib.diagnosis.words.member_sizes import main_value, moved_mm
from calib.diagnosis.words.phrases import meaning
from calib.effects.effect import Effect, describe, family_name


def cause_of(effect: str, before: Calibration, after: Calibration) -> Cause:
    """An effect that was added between two fits of the same points."""
    members = [member for member in after.model.effects if family_name(member) == effect]
    moved = moved_mm(members, after) if len(members) > 1 else [0.0] * len(members)
    order = sorted(range(len(members)), key=lambda k: -moved[k])
    joints = [joint + 1 for k in order if (joint := getattr(members[k], "joint", None)) is not None]
    return Cause(
        effect,
        tuple(dict.fromkeys(joints)),
        _size(members[order[0]], after) if order else "",
        _largest_change(before, after),
        describe(members[0]).noun if members else "",
    )


def worst_pose(calibration: Calibration, poses: tuple[str, ...] = ()) -> AtPose | None:
    """The pose that is off the most, of some poses or of all."""
    after, ids = calibration.after, calibration.dataset.poses.ids
    error_mm = np.linalg.norm(after.error_mm, axis=1)
    if poses:
        error_mm = np.where(np.isin(np.array(ids)[after.pose], poses), error_mm, -1.0)
    if error_mm.max(initial=-1.0) < 0.0:
        return None
    worst = int(np.argmax(error_mm))
    return AtPose(ids[after.pose[worst]], float(error_mm[worst]))


def _largest_change(before: Calibration, after: Calibration) -> AtPose | None:
    """Where the predicted point moved the most from one fit to the other, in the scanner's frame."""
    if not np.array_equal(before.after.pose, after.after.pose) or not len(after.after.pose):
        return None
    change_mm = np.linalg.norm(after.after.error_mm - before.after.error_mm, axis=1)
    most = int(np.argmax(change_mm))
    return AtPose(after.dataset.poses.ids[after.after.pose[most]], float(change_mm[most]))


def _size(member: Effect, calibration: Calibration) -> str:
    """How large a member is, as a person reads it: an amplitude in degrees, or its surest value."""
    main = main_value(member, calibration)
    if main is None:
        return ""
    if main.parameter is None:
        return f"{np.degrees(main.value):.2g}\N{DEGREE SIGN}"
    return meaning(member, main.parameter, main.value, calibration) or f"{main.value:.2g} {main.unit}"
