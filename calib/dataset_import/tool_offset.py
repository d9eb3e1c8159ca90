"""Measured point of the tool as the user gives it: its offset from the end of the robot's file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import frames
from calib.array_types import Vector
from calib.kinematics.tool_point import ending_at_tool_point, tip_T_last, with_own_tool_point, with_tool_point
from calib.robot_formats.chain.five_parameters import vector
from calib.robot_formats.robot_file import RobotFile


def with_tool_offset(file: RobotFile, offset_mm: Vector) -> RobotFile:
    """Robot whose measured point is at an offset, mm, from the end of its file.

    A URDF and other files of a chain end at a flange: the point becomes the target "jig" of robot.toml, at the offset
    in the flange's frame, and the tool row keeps the flange. In a robot.toml [tool] is the tool: the tool row then ends
    at the offset in the flange's frame.
    """
    point_mm = np.array(offset_mm, dtype=float)
    if file.chain is None:
        in_last_mm = frames.apply(file.robot.flange.transform, point_mm)
        return replace(file, robot=with_tool_point(ending_at_tool_point(file.robot), in_last_mm))
    in_last_mm = frames.apply(frames.invert(tip_T_last(file.robot)), point_mm)
    return replace(file, robot=with_own_tool_point(file.robot, vector(in_last_mm)))
