"""Faults of one joint outside the catalogue: a damaged place in its gear, a jump of its zero, a smooth motion.

Each is evaluated as the effects are, by its log evidence. None is ever named as a cause; but where one has more
evidence than the best effect, that effect is not named either: three harmonics follow a dent in a gear closely, a drift
follows a slip, and only the comparison of the evidences tells them apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.kinematics.robot import Robot
from calib.screening.evidence import FamilyColumns, evaluate_family, evidence_of
from calib.screening.projected_residual import ProjectedResidual, joint_directions

_WIDTHS_RAD = (0.12, 0.2, 0.35)  # standard deviations of a dent's shape
_FEWEST = 2.0  # poses, each counted by the bump's height there: below, a bump is only an outlier
_AT_ENDS = 3  # poses before the first place where a jump is looked for, and after the last
_MOST = 200  # places of a jump, and poses that a smooth motion is spanned by: memory stays bounded
_OWN_RAD = (0.3, 0.6)  # correlation lengths of a smooth motion over the joint's own angle
_ARM_RAD = (0.8, 1.5)  # over the angles of the first three joints
_USUAL = 3e-4  # rad: as large as errors of drives are
_GAINS = np.geomspace(1e-2, 1e6, 60)  # of one column: its prior variance over the noise's


@dataclass(frozen=True)
class JointFault:
    """The likeliest of its kind. `log_evidence` is the whole kind's: all joints, widths and places equally likely."""

    kind: str  # "bump", "jump" or "smooth"
    joint: int
    log_evidence: float
    size: float  # rad, or mm of a prismatic joint; rms over the poses for "smooth"
    unit: str  # "rad" or "mm"
    place_rad: float = float("nan")  # of a bump
    width_rad: float = float("nan")  # of a bump, one standard deviation
    pose_id: str = ""  # the first pose after a jump


def best_bump_or_jump(projected: ProjectedResidual) -> JointFault | None:
    """The likeliest bump or jump of one joint; None where no joint shows in what is measured."""
    poses = projected.residuals.observed.used_poses[0]
    robot = projected.state.robot
    found: list[tuple[float, JointFault]] = []
    for joint, direction in enumerate(joint_directions(projected)):
        if np.any(direction):
            for shapes, faults in (*_bumps(robot, poses, joint), *_jumps(robot, poses, joint)):
                found.append(_likeliest(projected, projected.motion_columns(direction, shapes), faults))
    return _of_all(found)


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
            tried.append((evidence_of(-projected.residual, columns, projected.freedom), joint, span))
    if not tried:
        return None
    _, joint, span = max(tried, key=lambda one: one[0])
    columns = projected.motion_columns(directions[joint], _USUAL * span)
    evaluated = evaluate_family(FamilyColumns(-projected.residual, (columns,), projected.freedom))
    size = _USUAL * float(np.sqrt(np.mean((span @ evaluated.coefficients[0]) ** 2)))
    total = _mean_likelihood(np.array([value for value, _, _ in tried]))
    return JointFault("smooth", joint, total, size, "rad")


def best_supported_fault(projected: ProjectedResidual, floor: float) -> JointFault | None:
    """The fault that a residual shows with more than `floor` in log evidence; a bump or jump before a smooth motion."""
    definite, smooth = best_bump_or_jump(projected), smooth_motion(projected)
    if definite is not None and definite.log_evidence > max(floor, smooth.log_evidence if smooth else floor):
        return definite
    return smooth if smooth is not None and smooth.log_evidence > floor else None


def _of_all(found: list[tuple[float, JointFault]]) -> JointFault | None:
    """The best, with the evidence of all: the mean of their likelihoods."""
    if not found:
        return None
    total = _mean_likelihood(np.array([value for value, _ in found]))
    return replace(max(found, key=lambda one: one[0])[1], log_evidence=total)


def _mean_likelihood(log_evidence: Array) -> float:
    """log mean exp of (K,)."""
    top = float(np.max(log_evidence))
    return top + float(np.log(np.mean(np.exp(log_evidence - top))))


def _likeliest(
    projected: ProjectedResidual, columns: Array, faults: list[JointFault]
) -> tuple[float, JointFault]:
    """Mean likelihood of single columns (R, K) as a log evidence, and the best of them with its size.

    As `evidence.evaluate_family` for one column each: -1/2 log(1 + g) - nu/2 log(1 - share g / (1 + g)) at the best g,
    which is its coefficient's prior variance times |column|^2 over the noise's; share is that of the residual along the
    column.
    """
    missing = -projected.residual
    square = np.sum(columns**2, axis=0)
    along = columns.T @ missing
    seen = square > 1e-9 * max(float(square.max()), 1e-300)
    share = np.where(seen, along**2 / np.where(seen, square, 1.0), 0.0) / max(
        float(missing @ missing), 1e-300
    )
    kept = share * (_GAINS / (1.0 + _GAINS))[:, None]  # (gains, K)
    values = -0.5 * np.log1p(_GAINS)[:, None] - 0.5 * projected.freedom * np.log1p(
        -np.minimum(kept, 1.0 - 1e-12)
    )
    each = np.max(values, axis=0)
    best = int(np.argmax(each))
    size = float(along[best] / square[best]) if seen[best] else 0.0
    return _mean_likelihood(each), replace(faults[best], size=size)


def _bumps(robot: Robot, poses: Poses, joint: int) -> list[tuple[Array, list[JointFault]]]:
    """For each width the bumps (N, K) along a revolute joint's range that several poses show."""
    if not robot.joints[joint].is_revolute:
        return []
    angle = poses.q[:, joint]
    out = []
    for width in _WIDTHS_RAD:
        places = np.arange(angle.min(), angle.max() + 0.5 * width, 0.5 * width)
        off_rad = np.remainder(angle[:, None] - places + np.pi, 2.0 * np.pi) - np.pi
        shapes = np.exp(-0.5 * (off_rad / width) ** 2)
        shown = np.sum(shapes, axis=0) > _FEWEST
        if shown.any():
            faults = [JointFault("bump", joint, 0.0, 0.0, "rad", float(p), width) for p in places[shown]]
            out.append((shapes[:, shown], faults))
    return out


def _jumps(robot: Robot, poses: Poses, joint: int) -> list[tuple[Array, list[JointFault]]]:
    """Steps (N, K) between poses in the order of measuring."""
    count = len(poses)
    order = np.arange(count) if poses.time_s is None else np.argsort(poses.time_s, kind="stable")
    if count <= 2 * _AT_ENDS:
        return []
    firsts = np.unique(np.linspace(_AT_ENDS, count - _AT_ENDS, min(_MOST, count)).astype(int))
    rank = np.empty(count, dtype=int)
    rank[order] = np.arange(count)
    shapes = (rank[:, None] >= firsts).astype(float)
    unit = "rad" if robot.joints[joint].is_revolute else "mm"
    return [
        (shapes, [JointFault("jump", joint, 0.0, 0.0, unit, pose_id=poses.ids[order[k]]) for k in firsts])
    ]


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
