"""Serial arm of joints with any axes, each placed in the previous joint's frame: what every robot format is read into.

A joint's frame moves with its link. At zero it is at `before_T_joint` in the frame of the joint before, the base
frame for the first; the joint turns about its axis by q (rad) or slides along it by q (mm).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, Vector
from calib.errors import CalibError
from calib.frames import make_transform, rotation_from_rotvec


class RobotFileError(CalibError):
    """Error: a robot's file cannot be used, or its format cannot hold the robot."""


@dataclass(frozen=True)
class ChainJoint:
    """A joint and the link that it moves; limits in rad, or mm for a prismatic joint."""

    name: str
    before_T_joint: Array  # (4, 4) at zero, mm
    axis: Vector = (0.0, 0.0, 1.0)  # unit vector in the joint's frame
    type: str = "revolute"  # or "prismatic"
    min: float | None = None
    max: float | None = None
    mass_kg: float | None = None
    com_mm: Vector | None = None  # in the joint's frame
    gear_ratio: float | None = None

    @property
    def is_revolute(self) -> bool:
        return self.type == "revolute"


@dataclass(frozen=True)
class SerialChain:
    """A serial arm from its base frame to its tip."""

    name: str
    joints: tuple[ChainJoint, ...]
    last_T_tip: Array  # (4, 4) from the tip's frame to that of the last joint, mm
    gravity_m_s2: Vector = (0.0, 0.0, -9.81)  # in the base frame
    base: str = ""  # names of the links, where the file has them
    tip: str = ""
    coupling: tuple[tuple[float, ...], ...] = ()  # as of Robot: (n, n) joint values by commanded ones
    tool_point_mm: Vector | None = None  # the measured point, in the tip's frame, where it is not the tip itself
    notes: tuple[str, ...] = ()  # what was left out or taken for granted, a sentence each
    tip_T_flange: Array | None = None  # (4, 4) mm from the controller's flange to the tip; None where the tip is it

    @property
    def at_zero(self) -> Array:
        """Transforms (n + 1, 4, 4) at zero: base_T_joint of all joints, then base_T_tip."""
        return chain_frames(self, np.zeros((1, len(self.joints))))[0]


def chain_frames(chain: SerialChain, q: ArrayLike) -> Array:
    """Transforms (N, n + 1, 4, 4) at q (N, n), rad or mm: base_T_joint of all joints, then base_T_tip."""
    q = np.asarray(q, dtype=float)
    frame = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    frames = []
    for joint, values in zip(chain.joints, q.T, strict=True):
        along = values[:, None] * np.array(joint.axis)
        still = np.zeros_like(along)
        turn, slide_mm = (along, still) if joint.is_revolute else (still, along)
        frame = frame @ joint.before_T_joint @ make_transform(rotation_from_rotvec(turn), slide_mm)
        frames.append(frame)
    return np.stack([*frames, frame @ chain.last_T_tip], axis=1)


def axis_frame(joint: ChainJoint) -> Array:
    """Transform joint_T_axis (4, 4): the least rotation of z onto the joint's axis."""
    x, y, z = joint.axis
    sine = np.hypot(x, y)
    if sine == 0.0:  # along z or against it, where half a turn about x is taken
        turn = np.zeros(3) if z > 0.0 else np.array([np.pi, 0.0, 0.0])
        if z > 0.0:
            return np.eye(4)
        return np.diag([1.0, -1.0, -1.0, 1.0])
    turn = np.arctan2(sine, z) / sine * np.array([-y, x, 0.0])
    return make_transform(rotation_from_rotvec(turn), np.zeros(3))
