"""Where a scanner is put when nobody says where it stands."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.frames import make_transform
from calib.kinematics.chain import forward
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot

_ONE_WAY = 0.6  # length of the mean of the jig's axes from which they count as pointing one way
_DRAWN = 2000  # poses


def in_front(robot: Robot) -> tuple[Array, Array]:
    """The middle of an arm's reach in front of it (3,), mm, and the turn of a scanner that looks back (3, 3)."""
    q = random_poses(robot, _DRAWN, rng=np.random.default_rng(0))
    reach_mm = float(
        np.linalg.norm(forward(robot.table, q, robot.is_revolute, robot.base_T_first).target_mm, axis=1).max()
    )
    looking_back = np.array(
        [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    )  # columns: scanner x, y, z in base
    return np.array([0.47 * reach_mm, 0.0, 0.42 * reach_mm]), looking_back


def likely_scanner_place(robot: Robot, tool_T_jig: Array, distance_mm: float) -> Array:
    """base_T_scanner (4, 4) from which such an arm's jig can be seen: in front of the arm, looking back at it.

    An arm that cannot turn its jig around (a SCARA, a gantry) is looked at from where the jig points, in the middle of
    its reach.
    """
    q = random_poses(robot, _DRAWN, rng=np.random.default_rng(0))
    chain = forward(robot.table, q, robot.is_revolute, robot.base_T_first)
    axes = (chain.base_T_frame[:, -1] @ tool_T_jig)[:, :3, 2]  # into the material: as the scanner looks
    mean = axes.mean(axis=0)
    if np.linalg.norm(mean) < _ONE_WAY:
        middle_mm, turn = in_front(robot)
    else:
        middle_mm = np.median(chain.target_mm, axis=0)
        z = mean / np.linalg.norm(mean)
        x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        turn = np.column_stack([x, np.cross(z, x), z])
    return make_transform(turn, middle_mm - distance_mm * turn[:, 2])
