"""Positions and orientations in the numbers of robot makers: UR rotation vectors, KUKA A B C, ABB quaternions.

URScript: m and a rotation vector in rad. KRL: mm and degrees, R = Rz(A) Ry(B) Rx(C). RAPID: mm and a quaternion with
its scalar part first. Sources as in `calib.extras.robot_programs.point_lists`.
"""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.frames import (
    make_transform,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rotvec,
    rotation_from_rpy,
    rotvec_from_rotation,
    rpy_from_rotation,
)

NUMBERS = {"URScript": 6, "KRL": 6, "RAPID": 7}
FORM = {
    "URScript": "x,y,z,rx,ry,rz in m and rad",
    "KRL": "X,Y,Z,A,B,C in mm and degrees",
    "RAPID": "x,y,z,q1,q2,q3,q4 in mm",
}
"""What a frame's numbers are, for messages."""
_UNIT_TOLERANCE = 0.01  # of a quaternion's length, which programs round
_LEVEL = 1e-9  # cosine of B below which A and C are one turn


def pose_transform(language: str, values: Array) -> Array:
    """Transform (4, 4), mm, of a pose in the maker's numbers. Raises ValueError for no unit quaternion."""
    position, turn = values[:3], values[3:]
    if language == "URScript":
        return make_transform(rotation_from_rotvec(turn), 1000.0 * position)
    if language == "KRL":
        return make_transform(rotation_from_rpy(np.radians(turn[::-1])), position)
    length = float(np.linalg.norm(turn))
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"the quaternion has length {length:.4g}, not 1")
    return make_transform(rotation_from_quaternion(turn), position)


def pose_values(language: str, transform: Array, like: Array) -> Array:
    """Numbers of a pose in the maker's form, of all that mean the same those nearest to given ones."""
    position, rotation = transform[:3, 3], transform[:3, :3]
    if language == "URScript":
        return np.concatenate([position / 1000.0, _rotvec_near(rotation, like[3:])])
    if language == "KRL":
        return np.concatenate([position, _abc_near(rotation, like[3:])])
    quaternion = quaternion_from_rotation(rotation)
    return np.concatenate([position, quaternion if quaternion @ like[3:] >= 0.0 else -quaternion])


def least_decimals(language: str, kind: str, count: int) -> list[int]:
    """Decimals that each number of a target is written with at least."""
    if language == "URScript":
        return [6] * count
    if kind == "joints":
        return [4] * count
    return [3] * 3 + [4 if language == "KRL" else 8] * (count - 3)


def _rotvec_near(rotation: Array, like: Array) -> Array:
    rotvec = rotvec_from_rotation(rotation)
    angle = float(np.linalg.norm(rotvec))
    if angle < 1e-12:
        return rotvec
    turns = [rotvec * (1.0 + 2.0 * np.pi * k / angle) for k in (-2, -1, 0, 1, 2)]
    return min(turns, key=lambda v: float(np.linalg.norm(v - like)))


def _abc_near(rotation: Array, like: Array) -> Array:
    if np.hypot(rotation[0, 0], rotation[1, 0]) < _LEVEL:
        up = -float(np.sign(rotation[2, 0]))  # 1 at B = 90 deg, where A - C counts alone
        single = float(np.arctan2(-rotation[0, 1], rotation[1, 1]))
        both = [np.degrees([single + up * np.radians(like[2]), up * np.pi / 2.0, np.radians(like[2])])]
    else:
        a, b, c = np.degrees(rpy_from_rotation(rotation)[::-1])
        both = [np.array([a, b, c]), np.array([a + 180.0, 180.0 - b, c + 180.0])]
    near = [abc + 360.0 * np.round((like - abc) / 360.0) for abc in both]
    return min(near, key=lambda abc: float(np.linalg.norm(abc - like)))
