"""The range of an arm's joints, and joint vectors drawn from it."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.kinematics.robot import Robot


def joint_limits(robot: Robot) -> tuple[Array, Array]:
    """Least and largest value (n,) of each joint, rad or mm; infinite where robot.toml has no limit."""
    low = np.array([-np.inf if joint.min is None else joint.min for joint in robot.joints])
    high = np.array([np.inf if joint.max is None else joint.max for joint in robot.joints])
    return low, high


def joint_range(robot: Robot) -> tuple[Array, Array]:
    """Lower and upper bounds (n,) of the joints: their own limits, and half a turn either way for revolute ones.

    A prismatic joint without limits goes from 0 to 500 mm.

    Raises:
        CalibError: a joint has no range between its bounds.
    """
    low, high = joint_limits(robot)
    low = np.where(robot.is_revolute, np.maximum(low, -np.pi), np.where(np.isfinite(low), low, 0.0))
    high = np.where(robot.is_revolute, np.minimum(high, np.pi), np.where(np.isfinite(high), high, 500.0))
    if np.any(low >= high):
        j = int(np.argmax(low >= high))
        raise CalibError(
            f"robot {robot.name}: joint {robot.joints[j].name} has no range within +-180 deg "
            f"of zero (limits {robot.joints[j].min}, {robot.joints[j].max} rad)"
        )
    return low, high


def random_poses(robot: Robot, count: int, *, rng: np.random.Generator) -> Array:
    """Random joint vectors (count, n), uniform within +-180 deg (Park 2022) and the joints' limits."""
    low, high = joint_range(robot)
    return rng.uniform(low, high, (count, robot.n_joints))


def wrapped(q: Array, low: Array) -> Array:
    """Angles shifted by whole turns to the first value at or above the lower joint limits."""
    return low + np.mod(q - low, 2.0 * np.pi)
