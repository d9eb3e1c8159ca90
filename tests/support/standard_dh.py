"""Elementary transforms, standard Denavit-Hartenberg tables made of them, and these in extended precision."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot


def tips(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Tip transforms (N, 4, 4) of a robot."""
    return nominal_chain(robot, q).base_T_frame[:, -1]


def joints_at_random(count: int, n: int) -> np.ndarray:
    """Joint vectors (count, n), rad."""
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (count, n))


def rot(axis: str, angle: float) -> np.ndarray:
    """Rotation about an axis."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return out


def trans(x: float, y: float, z: float) -> np.ndarray:
    """Shift."""
    out = np.eye(4)
    out[:3, 3] = (x, y, z)
    return out


def standard(rows: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Tip transform (4, 4) of a standard Denavit-Hartenberg table with rows theta, a, d, alpha."""
    out = np.eye(4)
    for (theta, a, d, alpha), value in zip(rows, q, strict=True):
        out = out @ rot("z", theta + value) @ trans(a, 0, d) @ rot("x", alpha)
    return out


def exactly(rows: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Tip transform of a standard table in extended precision, as d of hundreds of metres costs three digits."""
    out = np.eye(4, dtype=np.longdouble)
    for (theta, a, d, alpha), value in zip(rows.astype(np.longdouble), q, strict=True):
        c, s, ca, sa = np.cos(theta + value), np.sin(theta + value), np.cos(alpha), np.sin(alpha)
        row = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        out = out @ np.array(row, dtype=np.longdouble)
    return out.astype(float)
