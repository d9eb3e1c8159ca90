"""The jig on its tool: its frame on the tool, and the inverse problem of bringing its apex and axis to a goal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.frames import make_transform
from calib.jig import Jig, jig_geometry
from calib.kinematics.chain import Chain, joint_jacobian, nominal_chain
from calib.kinematics.robot import Robot

_LEVER_MM = 300.0  # weighs one radian of the jig's axis against millimetres
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


@dataclass(frozen=True)
class JigGoals:
    """Goals for the jig: its apex at N points and its axis along N directions; rotation about that axis is free."""

    robot: Robot
    axis_in_tool: Array  # (3,) unit, tool frame: from the jig towards its open side
    apex_mm: Array  # (N, 3) base frame
    outward: Array | None  # (N, 3) unit, base frame: where that axis shall point; None: anywhere
    prismatic_unit_mm: float = 1.0  # that counts as much as a radian

    @property
    def joint_units(self) -> Array:
        """(n,) unit of each joint: 1 rad, or the equivalent length in mm."""
        return np.where(self.robot.is_revolute, 1.0, self.prismatic_unit_mm)

    def pointing(self, chain: Chain) -> Array:
        """Direction (K, 3) of the jig's axis, base frame."""
        return chain.base_T_frame[:, -1, :3, :3] @ self.axis_in_tool

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """Errors of apex (mm) and axis, and their Jacobian by the joints.

        The axis' error is its sine times `_LEVER_MM`; rotations about the axis are taken out.
        """
        chain = nominal_chain(self.robot, q)
        moved, axes = joint_jacobian(chain, self.robot.is_revolute)
        off_mm = self.apex_mm[rows] - chain.target_mm
        if self.outward is None:
            return off_mm, moved * self.joint_units
        pointing, outward = self.pointing(chain), self.outward[rows]
        turn = np.cross(pointing, outward)
        # Where the axis points the wrong way round its sine vanishes too: any turn leads on.
        turn += np.where(np.sum(pointing * outward, axis=1) < -0.99, 0.1, 0.0)[:, None]
        axes = axes - pointing[:, :, None] * np.einsum("ki,kin->kn", pointing, axes)[:, None]
        error = np.concatenate([off_mm, _LEVER_MM * turn], axis=1)
        return error, np.concatenate([moved, _LEVER_MM * axes], axis=1) * self.joint_units

    def reached(self, q: Array) -> BoolArray:
        """Mask (N,): whether apex and axis are at their goals, to 1 mm and 0.02 rad."""
        chain = nominal_chain(self.robot, q)
        near = np.linalg.norm(self.apex_mm - chain.target_mm, axis=1) < 1.0
        if self.outward is None:
            return np.asarray(near)
        cosine = np.sum(self.pointing(chain) * self.outward, axis=1)
        return near & (np.arccos(np.clip(cosine, -1.0, 1.0)) < 0.02)
