"""What a residual may depend on: joint angles, torques, conditions, the place, any further column of poses.csv."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.dataset.input_names import CONDITIONS, ORDER, PLACES, further_inputs
from calib.effects.gravity import has_masses
from calib.effects.state import RobotState
from calib.kinematics.robot import Robot


def inputs_at(robot: Robot, poses: Poses, state: RobotState) -> dict[str, Array]:
    """Every input by its name, one value a pose (N,); what never changes is left out.

    Angles in rad, prismatic joints and places in mm (scanner frame), torques of gravity in N m, conditions in the unit
    that their name says. Words of a column become numbers in the order in which they first appear. `state` is the
    arm's at these poses.
    """
    inputs = {f"q{j + 1}": poses.q[:, j] for j in range(robot.n_joints)}
    if has_masses(robot):
        torques = state.gravity_torques_nm
        inputs |= {f"torque{j + 1}": torques[:, j] for j in range(robot.n_joints)}
    for name in CONDITIONS:
        values = getattr(poses, name)
        if values is not None:
            inputs[name] = values
    if poses.approach is not None:
        inputs |= {f"approach{j + 1}": poses.approach[:, j] for j in range(robot.n_joints)}
    seen = state.seen
    if seen is not None:
        inputs |= {axis: seen.scanner_mm[:, k] for k, axis in enumerate(PLACES)}
    inputs[ORDER] = np.arange(len(poses), dtype=float)
    for name, of in further_inputs(poses).items():
        column = poses.extra[of]
        inputs[name] = (
            column.to_numpy(dtype=float) if column.dtype.kind in "fiub" else column.factorize()[0].astype(float)
        )
    return {name: v for name, v in inputs.items() if len(np.unique(v)) > 1}
