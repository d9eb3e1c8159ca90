"""A joint that moves smoothly in a way that no effect of the catalogue describes: a fault that is told, never named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.screening.evidence import FamilyColumns, evaluate_family, evidence_of
from calib.screening.projected_residual import ProjectedResidual, joint_directions
from calib.screening.sparse_evidence import mean_likelihood

_MOST = 200  # poses that a smooth motion is spanned by: memory stays bounded
_OWN_RAD = (0.3, 0.6)  # correlation lengths of a smooth motion over the joint's own angle
_ARM_RAD = (0.8, 1.5)  # over the angles of the first three joints
_USUAL = 3e-4  # rad: as large as errors of drives are


@dataclass(frozen=True)
class JointFault:
    """The likeliest joint. `log_evidence` is that of all joints and ways of moving, equally likely."""

    kind: str  # "smooth"
    joint: int
    log_evidence: float
    size: float  # rad, rms over the poses
    unit: str  # "rad"
    visible_mm: float  # rms over the measured points of what the motion does beyond what a fit absorbed


def smooth_motion(projected: ProjectedResidual) -> JointFault | None:
    """A joint that moves smoothly with its own angle or with the first three joints, in whatever way.

    Gaussian processes of two correlation lengths over each; the evidence is of all together. None where no joint shows.
    """
    poses = projected.residuals.observed.used_poses[0]
    robot = projected.state.robot
    revolute = [j for j in range(robot.n_joints) if robot.joints[j].is_revolute]
    arm = poses.q[:, [j for j in revolute if j < 3]]
    spans = [_smooth(arm, length_rad) for length_rad in _ARM_RAD] if arm.shape[1] else []
    directions = joint_directions(projected)
    tried: list[tuple[float, int, Array]] = []
    for joint in revolute:
        if not np.any(directions[joint]):
            continue
        for span in (*spans, *(_smooth(poses.q[:, [joint]], length_rad) for length_rad in _OWN_RAD)):
            columns = projected.motion_columns(directions[joint], _USUAL * span)
            tried.append((evidence_of(-projected.residual, columns, projected.dof), joint, span))
    if not tried:
        return None
    _, joint, span = max(tried, key=lambda one: one[0])
    columns = projected.motion_columns(directions[joint], _USUAL * span)
    evaluated = evaluate_family(FamilyColumns(-projected.residual, (columns,), projected.dof))
    sigma_mm = np.sqrt(np.trace(projected.residuals.observed.covariance_mm2, axis1=1, axis2=2) / 3.0)
    moved_mm = evaluated.explained.reshape(-1, 3) * sigma_mm[:, None]
    size = _USUAL * float(np.sqrt(np.mean((span @ evaluated.coefficients[0]) ** 2)))
    total = mean_likelihood(np.array([value for value, _, _ in tried]))
    visible_mm = float(np.sqrt(np.mean(np.sum(moved_mm**2, axis=1))))
    return JointFault("smooth", joint, total, size, "rad", visible_mm)


def _smooth(angles_rad: Array, length_rad: float) -> Array:
    """(N, K) functions of angles (N, A) such that white coefficients make a Gaussian process of unit variance.

    Kernel prod_a exp((cos(angle_a - angle'_a) - 1) / length^2), by Nystroem's method over `_MOST` poses.
    """
    count = len(angles_rad)
    anchors = angles_rad[np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int))]

    def kernel(left: Array, right: Array) -> Array:
        return np.asarray(np.exp(np.sum(np.cos(left[:, None] - right[None]) - 1.0, axis=2) / length_rad**2))

    values, vectors = np.linalg.eigh(kernel(anchors, anchors))
    kept = values > 1e-3 * values[-1]
    return np.asarray(kernel(angles_rad, anchors) @ (vectors[:, kept] / np.sqrt(values[kept])))
