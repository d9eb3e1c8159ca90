"""The jig on its tool: its frame there, and the tool row that reaches to its apex."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.frames import make_transform
from calib.jig import Jig, jig_geometry
from calib.kinematics.robot import Robot

JIG_HEIGHT_MM = 88.0
"""From the flange to the jig's apex, Jang's Table 2; taken where a robot's tool row has no length of its own."""


def jig_outward(robot: Robot) -> float:
    """Sign, +1 or -1, of the tool frame's z axis on the side to which the jig's apex points, away from the flange."""
    return -1.0 if robot.tool.d_mm < 0 else 1.0


def target_T_jig(robot: Robot) -> Array:
    """Pose (4, 4) of the jig's frame (apex, z into the material) in the tool frame, whose origin is the apex too."""
    return make_transform(np.diag([1.0, -jig_outward(robot), -jig_outward(robot)]), np.zeros(3))


def with_jig(robot: Robot, jig: Jig) -> Robot:
    """The robot with a tool row that reaches from the flange to a jig's apex, added where it has none."""
    if abs(robot.tool.d_mm) > float(np.abs(jig_geometry(jig)[0][:, 2]).mean()) + 1.0:
        return robot
    return replace(robot, tool=replace(robot.tool, d_mm=JIG_HEIGHT_MM))
