"""An arm that stands for the poses of a flange as a controller tells them: three slides and three turns, all exact.

Its joint values are the place x, y, z (mm) and the turns about z, y and x (rad) of the flange, in the order in which
they follow one another, so that whatever takes an arm takes such poses. Its links are no arm's and are never fitted.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.errors import FitError
from calib.kinematics.robot import TOOL_POINT, FixedFrame, Joint, Robot, Target

_QUARTER = math.pi / 2.0
_ANYWHERE_MM = 1000.0  # sigma of the place of what is measured on the flange
_ROWS = (  # name, type, alpha, theta, beta: each row turns the next axis to where the next joint needs it
    ("x", "prismatic", -_QUARTER, 0.0, 0.0),
    ("y", "prismatic", 0.0, 0.0, -_QUARTER),
    ("z", "prismatic", 0.0, -_QUARTER, 0.0),
    ("rz", "revolute", -_QUARTER, 0.0, 0.0),
    ("ry", "revolute", 0.0, 0.0, _QUARTER),
    ("rx", "revolute", 0.0, _QUARTER, -_QUARTER),
)


def cartesian_arm(name: str) -> Robot:
    """Robot whose flange is at the pose that `joints_of_poses` gives its joints for."""
    joints = tuple(
        Joint(name=axis, type=kind, alpha_rad=alpha, theta_rad=theta, beta_rad=beta)
        for axis, kind, alpha, theta, beta in _ROWS
    )
    return Robot(name, joints, base=FixedFrame(rpy_rad=(0.0, _QUARTER, 0.0)), is_cartesian=True)


def with_board_anywhere(robot: Robot) -> Robot:
    """Robot that stands for poses of a flange, with what is measured on it at no known place; others as they are."""
    if not robot.is_cartesian or robot.carries_scanner:
        return robot
    return replace(robot, targets=(Target(TOOL_POINT, (0.0, 0.0, 0.0), _ANYWHERE_MM),))


def require_links(robot: Robot, what: str) -> None:
    """Raise FitError, naming what was asked for, where a robot stands for poses of the flange and has no links."""
    if robot.is_cartesian:
        raise FitError(
            f"{robot.name}: these are poses of the flange, as its controller tells them; {what} needs the arm's links: "
            "import it anew with --robot and a table of joint values (--joints)"
        )


def joints_of_poses(base_T_flange: Array) -> Array:
    """Joint values (N, 6) of a `cartesian_arm` at poses (N, 4, 4) of its flange: mm, then rad."""
    rpy_rad = np.stack([frames.rpy_from_rotation(pose[:3, :3]) for pose in base_T_flange])
    return np.concatenate([base_T_flange[:, :3, 3], rpy_rad[:, ::-1]], axis=1)
