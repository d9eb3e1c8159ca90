"""Joint targets as a ROS trajectory: trajectory_msgs/JointTrajectory in YAML, as `ros2 topic pub` takes it.

Source: ROS, *trajectory_msgs/msg/JointTrajectory* and *builtin_interfaces/msg/Duration*: positions in rad or m, seconds
and nanoseconds from the start.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from calib.array_types import Array
from calib.errors import visible
from calib.kinematics.robot import Robot
from calib.robot_formats.programs.point_lists import JointTarget

SLOW_RAD_S, SLOW_MM_S = 0.25, 50.0  # of the joint that moves the most between two targets
STANDS_S = 3.0  # at each target, for the measurement
_FIRST_S = 10.0  # to the first target, from wherever the arm stands


def trajectory_yaml(robot: Robot, targets: Sequence[JointTarget], heading: Sequence[str]) -> str:
    """The targets in their order; the arm stands at each for some seconds, so each is two points.

    heading: lines that say what they are, put first as comments.
    """
    names = [joint.name or f"joint{k + 1}" for k, joint in enumerate(robot.joints)]
    lines = [
        *(f"# {visible(' '.join(words.split()))}" for words in heading),
        f"# trajectory_msgs/msg/JointTrajectory; {STANDS_S:g} s at each target, joints at most "
        f"{SLOW_RAD_S:g} rad/s or {SLOW_MM_S:g} mm/s",
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        "  frame_id: ''",
        f"joint_names: [{', '.join(json.dumps(name) for name in names)}]",
        "points:" if targets else "points: []",
    ]
    for (target, arrives_s), k in zip(_times(robot, targets), range(len(targets)), strict=True):
        position = np.where(robot.is_revolute, target.q, target.q / 1000.0)
        told = f"[{', '.join(f'{v:.9f}' for v in position)}]"
        still = f"[{', '.join(['0.0'] * len(position))}]"
        for seconds in (arrives_s, arrives_s + STANDS_S):
            whole = int(seconds)
            lines += [
                f"- positions: {told}  # {json.dumps(target.name)}, number {k + 1}",
                f"  velocities: {still}",
                f"  time_from_start: {{sec: {whole}, nanosec: {round((seconds - whole) * 1e9)}}}",
            ]
    return "\n".join(lines) + "\n"


def _times(robot: Robot, targets: Sequence[JointTarget]) -> list[tuple[JointTarget, float]]:
    """Each target with the second of arrival, whole tenths."""
    speed = np.where(robot.is_revolute, SLOW_RAD_S, SLOW_MM_S)
    out: list[tuple[JointTarget, float]] = []
    at: Array | None = None
    now = _FIRST_S
    for target in targets:
        if at is not None:
            # a smooth way from rest to rest is half as fast again in its middle as on average
            now += STANDS_S + max(1.0, 1.5 * float(np.max(np.abs(target.q - at) / speed)))
        now = float(np.ceil(10.0 * now) / 10.0)
        out.append((target, now))
        at = target.q
    return out
