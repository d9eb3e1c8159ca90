"""Couplings of all joints: an unknown smooth error of each joint over the angles of the whole arm.

Where cables run through an arm, each joint gives way as all others stand. A joint's error is then a sum of sines and
cosines of every joint's angle, and of the sum and difference of every pair, with one size for each joint, all sizes
chosen by evidence together: no single coupling passes a gate alone.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from calib.array_types import IndexArray
from calib.blas_threads import one_blas_thread
from calib.kinematics.robot import Robot
from calib.screening.curves.curve_evidence import CurveColumns, CurveEvidence
from calib.screening.curves.joint_curves import MIN_LOG_EVIDENCE, MOST_WORK, LearnedCurves, visible_modes
from calib.screening.curves.law_search import MIN_STANDARD_ERRORS, left_out_with, standard_errors_of_fall
from calib.screening.curves.smooth_joint_error import CouplingModes, SmoothJointError
from calib.screening.left_out import left_out_errors_mm
from calib.screening.projected_residual import ProjectedResidual, joint_directions
from calib.statistics import rms

_LEAST_JOINTS = 3  # that turn: with fewer, curves over both and their sums are the same


@one_blas_thread()
def learn_couplings(projected: ProjectedResidual) -> LearnedCurves | None:
    """Errors of joints over the angles of the whole arm that a residual supports; None where there are none.

    They have to reach the evidence that curves need, and to lower the error of poses left out one by one clearly.
    """
    robot = projected.residuals.model.robot
    inputs = coupling_inputs(robot)
    turning = robot.revolute_joints
    columns_each, rows = 2 * len(inputs), len(projected.residual)
    if len(turning) < _LEAST_JOINTS or rows**2 * columns_each * len(turning) > MOST_WORK:
        return None
    modes = CouplingModes(inputs, np.eye(columns_each))
    at_poses = modes.at_state(projected.state)
    directions = joint_directions(projected)
    blocks = [projected.motion_columns(directions[j], at_poses) for j in turning]
    columns = np.concatenate([projected.in_free(block) for block in blocks], axis=1)
    member: IndexArray = np.repeat(np.arange(len(turning)), columns_each)
    order = np.ones(len(member), dtype=np.int64)
    residual = -projected.in_free(projected.residual)
    evidence = CurveEvidence(CurveColumns(columns, member, order, np.zeros(len(member), bool)), residual, projected.dof)
    value, spectrum = evidence.best()
    if value < MIN_LOG_EVIDENCE:
        return None
    posterior = evidence.at(spectrum)
    noise = float(np.sqrt(posterior.quadratic / evidence.dof))
    members: list[SmoothJointError] = []
    for k, joint in enumerate(turning):
        spread = posterior.prior_sigma[member == k] * noise
        weights, sizes = visible_modes(at_poses * spread, spread, blocks[k], noise)
        if sizes:
            members.append(SmoothJointError(joint, CouplingModes(inputs, weights), sizes))
    if not members:
        return None
    left_out_mm = left_out_with(projected, members, noise)
    if standard_errors_of_fall(projected, left_out_errors_mm(projected), left_out_mm) < MIN_STANDARD_ERRORS:
        return None
    return LearnedCurves(tuple(members), value, rms(left_out_mm))


def coupling_inputs(robot: Robot) -> tuple[str, ...]:
    """Names of the angles of an arm's turning joints, and of the sum and difference of every pair of them."""
    turning = [j + 1 for j, joint in enumerate(robot.joints) if joint.is_revolute]
    pairs = [f"q{a}{sign}q{b}" for a, b in combinations(turning, 2) for sign in "+-"]
    return (*(f"q{j}" for j in turning), *pairs)
