"""The flange as the controller means it, to which programs, hand-eye calibrations and people at the pendant refer.

It is fixed to the last link, at `Robot.flange` in the last joint's frame ([flange] of robot.toml). What a fit calls the
flange (`Chain.base_T_flange`) is the last joint's frame itself, as any frame of that link serves there.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.frames import apply, invert
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import tip_T_last, tool_point_of


def flange_frames(robot: Robot, q: ArrayLike) -> Array:
    """Transforms base_T_flange (N, 4, 4) of the nominal arm to its controller's flange, at joint vectors q (N, n)."""
    return nominal_chain(robot, q).base_T_flange @ robot.flange.transform


def flange_T_tip(robot: Robot) -> Array:
    """Transform (4, 4) from the end of the tool's row to the controller's flange."""
    return invert(robot.flange.transform) @ invert(tip_T_last(robot))


def measured_point_on_flange(robot: Robot) -> Array:
    """Measured point of the tool (3,), mm in the frame of the controller's flange."""
    return apply(invert(robot.flange.transform), tool_point_of(robot))
