"""Pose of the scanner in the base frame: fitted to measured points, or a likely one where nothing was measured."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.frames import apply, best_fit_transform, make_transform
from calib.kinematics.chain import nominal_chain
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot

_TRIM = 5.0  # times the median residual: a point farther off says nothing of the scanner's place
_DRAWN = 8000  # poses
_NEAR_MM = 350.0  # from the field's middle, of a pose that counts as seen
_FACING = 0.8  # cosine of its jig's axis to the line of sight
_FEW = 8  # such poses


def random_reach_mm(robot: Robot) -> float:
    """Distance from the base, mm, of the farthest of 2000 random poses' tool points."""
    q = random_poses(robot, 2000, rng=np.random.default_rng(0))
    return float(np.linalg.norm(nominal_chain(robot, q).target_mm, axis=1).max())


def in_front(robot: Robot) -> tuple[Array, Array]:
    """Centre (3,), mm, base frame, of an arm's reach in front of it, and orientation (3, 3) of a scanner facing it."""
    reach_mm = random_reach_mm(robot)
    looking_back = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # columns: scanner x, y, z in base
    return np.array([0.47 * reach_mm, 0.0, 0.42 * reach_mm]), looking_back


def likely_scanner_place(robot: Robot, tool_T_jig: Array, distance_mm: float) -> Array:
    """base_T_scanner (4, 4) from which an arm's jig can be seen: in front of the arm and facing it.

    An arm that hardly brings its jig there, facing the scanner (a SCARA, a gantry), is seen in the middle of its reach,
    along the axis of the base from which its jig is faced most often.
    """
    q = random_poses(robot, _DRAWN, rng=np.random.default_rng(0))
    chain = nominal_chain(robot, q)
    axes = (chain.base_T_frame[:, -1] @ tool_T_jig)[:, :3, 2]  # into the material: as the scanner looks

    def faced(middle_mm: Array, look: Array) -> int:
        near = np.linalg.norm(chain.target_mm - middle_mm, axis=1) < _NEAR_MM
        return int(np.sum(near & (axes @ look > _FACING)))

    middle_mm, turn = in_front(robot)
    if faced(middle_mm, turn[:, 2]) < _FEW:
        middle_mm = np.median(chain.target_mm, axis=0)
        looks = np.concatenate([np.eye(3), -np.eye(3)])
        z = looks[int(np.argmax([faced(middle_mm, look) for look in looks]))]
        x = np.cross([0.0, 0.0, 1.0] if z[2] == 0.0 else [0.0, 1.0, 0.0], z)
        turn = np.column_stack([x, np.cross(z, x), z])
    return make_transform(turn, middle_mm - distance_mm * turn[:, 2])


def fitted_scanner_place(base_mm: Array, scanner_mm: Array) -> Array:
    """base_T_scanner (4, 4) that brings measured points (M, 3) onto the nominal arm's, without outliers."""
    base_T_scanner = best_fit_transform(scanner_mm, base_mm)
    off_mm = np.linalg.norm(apply(base_T_scanner, scanner_mm) - base_mm, axis=1)
    keep = off_mm <= _TRIM * np.median(off_mm)
    return best_fit_transform(scanner_mm[keep], base_mm[keep]) if keep.sum() >= 3 else base_T_scanner


def scanner_at(place_mm: Array, toward_mm: Array) -> Array:
    """base_T_scanner (4, 4) of an upright scanner at a place (3,) that looks at a point (3,): z forward, y down.

    Raises CalibError where both are the same point.
    """
    along = np.asarray(toward_mm, dtype=float) - place_mm
    length = float(np.linalg.norm(along))
    if length < 1.0:
        raise CalibError("the scanner looks at where it stands; name a point in front of it")
    z = along / length
    up = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    x = np.cross(z, up)
    x /= np.linalg.norm(x)
    return make_transform(np.column_stack([x, np.cross(z, x), z]), place_mm)
