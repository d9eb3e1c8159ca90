"""Smooth joint motions or slow drifts that no effect of the catalogue describes, tested but never named as a cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np

from calib.array_types import Array, IndexArray
from calib.effects.catalogue.order_steps import Step
from calib.effects.catalogue.thermal import MotorHeat
from calib.screening.candidates import Candidate
from calib.screening.evidence import FamilyColumns, evaluate_family, evidence_of
from calib.screening.member_columns import displacement_columns
from calib.screening.projected_residual import ProjectedResidual, joint_directions
from calib.screening.sparse_evidence import mean_likelihood
from calib.statistics import axis_variances, rms, rms_length

_OWN_RAD = (0.3, 0.6)  # correlation lengths of a smooth motion over the joint's own angle
_ARM_RAD = (0.8, 1.5)  # over the angles of the first three joints
_USUAL = 3e-4  # rad: as large as errors of drives are
_SETTLING = (0.1, 0.2, 0.4, 0.8)  # time constants, as shares of the whole session
_SWAYING = (0.1, 0.2, 0.4, 1.0)  # correlation lengths, as shares of the whole session
_MOST_ANGLES, _MOST_MOMENTS = 200, 100  # poses that a smooth function is spanned by: memory stays bounded


# ---- of one joint ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JointFault:
    """Smooth error motion of the likeliest joint, with the log evidence averaged over all joints and motions tried."""

    kind: str  # "smooth"
    joint: int
    log_evidence: float
    size: float  # rad, rms over the poses
    unit: str  # "rad"
    visible_mm: float  # rms over the measured points of what the motion does beyond what a fit absorbed


def smooth_motion(projected: ProjectedResidual, *, of_one_angle: bool = False) -> JointFault | None:
    """Smooth error motion of the likeliest joint over its own angle or the first three joints'; or None.

    Gaussian processes of two correlation lengths over each; the evidence is of all together. None where no joint shows.

    of_one_angle: over the angle of any one joint instead.
    """
    poses = projected.residuals.observed.used_poses[0]
    revolute = projected.state.robot.revolute_joints
    own = {joint: [_over_angles(poses.q[:, [joint]], length_rad) for length_rad in _OWN_RAD] for joint in revolute}
    arm = poses.q[:, [j for j in revolute if j < 3]]
    spans = [_over_angles(arm, length_rad) for length_rad in _ARM_RAD] if arm.shape[1] else []
    directions = joint_directions(projected)
    tried: list[tuple[float, int, Array]] = []
    for joint in revolute:
        if not np.any(directions[joint]):
            continue
        for span in chain.from_iterable(own.values()) if of_one_angle else (*spans, *own[joint]):
            columns = projected.motion_columns(directions[joint], _USUAL * span)
            tried.append((evidence_of(-projected.residual, columns, projected.dof), joint, span))
    if not tried:
        return None
    _, joint, span = max(tried, key=lambda one: one[0])
    columns = projected.motion_columns(directions[joint], _USUAL * span)
    evaluated = evaluate_family(FamilyColumns(-projected.residual, (columns,), projected.dof))
    sigma_mm = np.sqrt(axis_variances(projected.residuals.observed.covariance_mm2))
    moved_mm = evaluated.explained.reshape(len(sigma_mm), -1) * sigma_mm[:, None]
    size = _USUAL * rms(span @ evaluated.coefficients[0])
    total = mean_likelihood(np.array([value for value, _, _ in tried]))
    visible_mm = rms_length(moved_mm)
    return JointFault("smooth", joint, total, size, "rad", visible_mm)


def _over_angles(angles_rad: Array, length_rad: float) -> Array:
    """Basis functions (N, K) of angles (N, A) whose standard normal weights give a unit Gaussian process.

    Kernel prod_a exp((cos(angle_a - angle'_a) - 1) / length^2), by Nystroem's method over `_MOST_ANGLES` poses.
    """

    def kernel(left: Array, right: Array) -> Array:
        return np.exp(np.sum(np.cos(left[:, None] - right[None]) - 1.0, axis=2) / length_rad**2)

    anchors = angles_rad[_spread(len(angles_rad), _MOST_ANGLES)]
    return kernel(angles_rad, anchors) @ _whitening(kernel(anchors, anchors))


def _spread(count: int, most: int) -> IndexArray:
    """Indices of at most `most` of a number of rows, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))


def _whitening(kernel: Array) -> Array:
    """Coefficients (A, K) by which kernel values at A anchors become basis functions of the Gaussian process."""
    values, vectors = np.linalg.eigh(kernel)
    kept = values > 1e-3 * values[-1]
    return vectors[:, kept] / np.sqrt(values[kept])


# ---- in place of a step ---------------------------------------------------------------------------------------------


def slow_course(projected: ProjectedResidual, step: Candidate) -> float:
    """Log evidence that the displacement explained by a step came slowly instead: creep, settling or oscillation.

    The best of an even course, settling with one of four time constants, and any smooth course of four correlation
    lengths, which are equally likely. 0 where the candidate is no step. What the same displacement at all poses adds
    beside the step counts for the step: it is another cause, as compliance is beside a payload that changed, and slow
    courses have it in them. Heat of a motor that the model has may have another course than its moves tell: so does
    its displacement.
    """
    members = [member for member in step.members if isinstance(member, Step)]
    if not members:
        return 0.0
    columns = displacement_columns(projected, members)  # (M, 3, W)
    heat = [member for member in projected.residuals.model.effects if isinstance(member, MotorHeat)]
    displacements = [columns, displacement_columns(projected, heat)] if heat else [columns]
    row = projected.residuals.observed.used_poses[1]

    def evidence(course: Array, columns: Array = columns) -> float:
        """Log evidence of a displacement times functions (N, L) of time."""
        moved = course[row][:, None, :, None] * columns[:, :, None, :]
        moved = moved.reshape(columns.shape[1] * len(row), -1)
        return evidence_of(-projected.residual, projected.visible(moved), projected.dof)

    values = [evidence(course, one) for course in _courses(_moments(projected)) for one in displacements]
    steps = np.concatenate([member.shapes(projected.state) for member in members], axis=1)
    always = evidence(np.column_stack([steps, np.ones(len(steps))])) - evidence(steps)
    return max(values) - float(np.log(len(values))) - max(always, 0.0)


def _moments(projected: ProjectedResidual) -> Array:
    """Time (N,) of each used pose, scaled to 0 to 1, or the pose's place in the order where times are not known."""
    poses = projected.residuals.observed.used_poses[0]
    when = poses.order.astype(float) if poses.time_s is None else poses.time_s
    return (when - when.min()) / max(float(np.ptp(when)), 1e-300)


def _courses(moment: Array) -> Iterator[Array]:
    """Basis functions (N, L) of time for each kind of slow course: even creep, settling, smooth oscillation."""
    yield moment[:, None]
    for settling in _SETTLING:
        yield (1.0 - np.exp(-moment / settling))[:, None]
    anchors = np.sort(moment)[_spread(len(moment), _MOST_MOMENTS)]
    for length in _SWAYING:
        yield _alike(moment, anchors, length) @ _whitening(_alike(anchors, anchors, length))


def _alike(left: Array, right: Array, length: float) -> Array:
    return np.exp(-0.5 * ((left[:, None] - right[None]) / length) ** 2)
