"""A cause as one says it: which joint, how large, and at which pose it moves the tool the most."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.diagnosis.words.conclusions import AtPose, Cause
from calib.diagnosis.words.phrases import meaning
from calib.effects.effect import Effect, family_name, full_name
from calib.fitting.observations import Observations, predict_points

NOUNS = {
    "joint_compliance": "the compliance of joint",
    "link_bending": "the bending of the link behind joint",
    "transmission_error": "the transmission error of joint",
    "strain_wave": "the strain wave gear's error of joint",
    "joint_scale": "a scale error of joint",
    "joint_coupling": "a coupling to its neighbour of joint",
    "backlash": "the backlash of joint",
    "gravity_backlash": "the backlash under gravity of joint",
    "thermal_growth": "the growth of the links with temperature",
    "base_compliance": "the compliance of the base",
    "axis_wobble": "the wobble of the axis of joint",
    "scanner_distortion": "the distortion of the instrument's field",
    "scanner_drift": "the drift of the instrument",
    "tool_sag": "the sag of the tool",
    "incidence_bias": "the instrument's error with the angle of incidence",
    "scanner_scale": "the scale of the instrument",
    "joint_step": "a step in the zero of joint",
    "joint_dent": "a dent in the gear of joint",
    "target_step": "a shift of the target on the tool",
    "scanner_step": "a move of the instrument",
    "base_loosening": "a base that came loose",
    "warm_up": "the growth of the links as the arm warms up",
    "following_error": "the following error of joint",
    "asymmetric_scale": "a scale error that differs on both sides of zero of joint",
    "high_harmonic": "a high harmonic in the gear of joint",
    "cable_drag": "the drag of the cables at joint",
    "nonlinear_stiffness": "the nonlinear stiffness of joint",
    "link_torsion": "the torsion of the link behind joint",
    "bearing_clearance": "the clearance in the bearing of joint",
}
"""What a family is called in a sentence; those that end in "joint" are followed by its number."""


def cause_of(effect: str, before: Calibration, after: Calibration) -> Cause:
    """An effect that was added between two fits of the same points."""
    members = [member for member in after.model.effects if family_name(member) == effect]
    moved_mm = _moved_mm(members, after)
    order = sorted(range(len(members)), key=lambda k: -moved_mm[k])
    joints = [joint + 1 for k in order if (joint := getattr(members[k], "joint", None)) is not None]
    return Cause(
        effect,
        tuple(dict.fromkeys(joints)),
        _size(members[order[0]], after) if order else "",
        _largest_change(before, after),
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


def _moved_mm(members: list[Effect], calibration: Calibration) -> list[float]:
    """How far each member by itself moves the measured points, rms about their mean."""
    if len(members) < 2:
        return [0.0] * len(members)
    model, x = calibration.model, calibration.fit.x
    names = [parameter.name for parameter in model.parameters]
    observed = Observations.of(calibration.fitted_dataset)
    with_all = predict_points(model, x, observed)

    def rms_mm(member: Effect) -> float:
        own = {full_name(member, parameter) for parameter in member.parameters}
        without = np.where([name in own for name in names], 0.0, x)
        shift: Array = with_all - predict_points(model, without, observed)
        return float(np.sqrt(np.mean((shift - shift.mean(axis=0)) ** 2)))

    return list(map(rms_mm, members))


def _size(member: Effect, calibration: Calibration) -> str:
    """How large a member is, as a person reads it: an amplitude in degrees, or its surest value."""
    fit = calibration.fit
    fitted = {p.name: (float(x), float(s)) for p, x, s in zip(fit.parameters, fit.x, fit.sigma, strict=True)}
    known = [p for p in member.parameters if full_name(member, p) in fitted]
    if not known:
        return ""
    values = [fitted[full_name(member, parameter)] for parameter in known]
    if len(known) > 1 and all(parameter.unit == "rad" for parameter in known):
        amplitude = float(np.sqrt(sum(value**2 for value, _ in values)))
        return f"{np.degrees(amplitude):.2g}\N{DEGREE SIGN}"
    surest = int(np.argmax([abs(value) / max(sigma, 1e-300) for value, sigma in values]))
    parameter, value = known[surest], values[surest][0]
    return meaning(member, parameter, value, calibration) or f"{value:.2g} {parameter.unit}"
