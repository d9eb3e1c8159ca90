"""Measured point of the tool: the end of the tool row, or an independent point on the last link.

A robot with a target named "jig" has its measured point there, in the last joint's frame; the tool's row then ends at
the tip, whose position and orientation a single measured point does not determine.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calib import frames
from calib.array_types import Array
from calib.frames import wrapped_angle
from calib.kinematics.chain import forward
from calib.kinematics.robot import PARAMETER_KINDS, TOOL_POINT, Robot, Target

_ON_AXIS_MM = 1e-9  # where a point has no direction from the last joint's axis
_A, _D, _THETA = (PARAMETER_KINDS.index(kind) for kind in ("a", "d", "theta"))


def tool_point_of(robot: Robot) -> Array:
    """Measured point of a robot's tool (3,), mm in the last joint's frame."""
    own = robot.own_tool_point
    return tool_point(robot.table) if own is None else np.array(own.xyz_mm)


def tool_point(table: Array) -> Array:
    """End (3,) of the tool row of a table (n + 1, 5), mm in the last joint's frame."""
    a, d, theta = table[-1, [_A, _D, _THETA]]
    return np.array([a * np.cos(theta), a * np.sin(theta), d])


def with_own_tool_point(robot: Robot, point_mm: ArrayLike) -> Robot:
    """Robot with an independent measured tool point, mm in the last joint's frame; the tool row stays as it is."""
    x, y, z = np.asarray(point_mm, dtype=float).tolist()
    others = tuple(target for target in robot.targets if target.name != TOOL_POINT)
    return replace(robot, targets=(Target(TOOL_POINT, (x, y, z)), *others))


def tip_T_last(robot: Robot) -> Array:
    """Transform (4, 4) from the last joint's frame to that of the tip, the end of the tool's row."""
    return np.asarray(frames.invert(forward(robot.table[-1:], np.zeros((1, 0)), []).base_T_frame[0, -1]))


def ending_at_tool_point(robot: Robot) -> Robot:
    """Robot whose tool row ends at the measured tool point, for measurements that do not involve the tip."""
    own = robot.own_tool_point
    if own is None:
        return robot
    others = tuple(target for target in robot.targets if target is not own)
    return with_tool_point(replace(robot, targets=others), np.array(own.xyz_mm))


def with_tool_point(robot: Robot, point_mm: Array) -> Robot:
    """Robot with the end of the tool row at another point, mm in the last joint's frame, turned as little as possible.

    p = (a cos theta, a sin theta, d) reaches any point twice, with a and with -a.
    """
    table = robot.table.copy()
    x, y, d = point_mm
    theta = table[-1, _THETA]
    turn = wrapped_angle(np.arctan2(y, x) - theta)
    turn -= np.copysign(np.pi, turn) if abs(turn) > 0.5 * np.pi else 0.0
    if np.hypot(x, y) > _ON_AXIS_MM:
        theta += turn
    table[-1, [_A, _D, _THETA]] = x * np.cos(theta) + y * np.sin(theta), d, theta
    return robot.with_table(table)
