"""The robot's state at every pose, which effects change before the forward pass, and what they may look at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

import calib.frames as frames
from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.display.brief import Brief
from calib.effects.gravity import GravityLoads
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import PARAMETER_KINDS, Robot


@dataclass(frozen=True)
class Seen(Brief):
    """Where the scanner sees the target at each of N poses; known where something was measured."""

    scanner_mm: Array  # (N, 3) measured, in the scanner's frame
    scanner_T_base: Array  # (N, 4, 4) as an earlier fit placed the scanner


@dataclass(frozen=True)
class RobotState(Brief):
    """Everything that decides where the target is, at each of N poses.

    Arrays have a leading axis of 1 until something depends on the pose.
    """

    robot: Robot
    poses: Poses
    table: Array  # (1 or N, n + 1, 5) rows a, alpha, d, theta, beta
    base_rotvec_rad: Array  # (1 or N, 3) turn of the whole arm about the base's origin
    displacement_mm: Array  # (1 or N, 3) of what the flange carries, base frame, after everything else
    target_offsets_mm: Mapping[str, Array] = field(default_factory=dict)  # further targets, in their link's frame, (3,)
    seen: Seen | None = None
    target_rotvec_rad: Array = field(default_factory=lambda: np.zeros((1, 3)))  # its turn about itself, base frame
    _loaded: list[RobotState] = field(default_factory=list, compare=False, repr=False)  # see `loaded`

    @classmethod
    def nominal(cls, robot: Robot, poses: Poses, seen: Seen | None = None) -> RobotState:
        """The robot as its table says, at poses (N)."""
        offsets = {target.name: np.array(target.xyz_mm) for target in robot.targets}
        return cls(robot, poses, robot.table[None], np.zeros((1, 3)), np.zeros((1, 3)), offsets, seen)

    def with_loads_at(self, loaded: RobotState) -> RobotState:
        """The same state, loads worked out at another."""
        return replace(self, _loaded=[loaded])

    def with_masses_of(self, robot: Robot, poses: Poses) -> RobotState:
        """The same state with a robot's masses and the payload of poses of the same joint positions."""
        out = replace(self, robot=robot, poses=poses)
        out.__dict__["chain"] = self.chain  # masses do not move it
        return out

    @property
    def q_rad(self) -> Array:
        """(N, n) joint positions as commanded; mm for prismatic joints."""
        return self.poses.q

    @cached_property
    def vector(self) -> Array:
        """(1 or N, S) all in one row a pose: table, base turn, displacement, target's turn, offsets of T targets.

        S = 5 (n + 1) + 9 + 3 T.
        """
        turns = [self.base_rotvec_rad, self.displacement_mm, self.target_rotvec_rad]
        offsets = [np.atleast_2d(offset_mm) for offset_mm in self.target_offsets_mm.values()]
        parts = [self.table.reshape(len(self.table), -1), *turns, *offsets]
        rows = max(map(len, parts))
        return np.concatenate([np.broadcast_to(p, (rows, p.shape[1])) for p in parts], axis=1)

    def add_link_error(self, frame: int, kind: str, error: ArrayLike) -> RobotState:
        """Add to one entry of the table: a scalar for all poses, or (N,) one a pose. Frame n is the tool row."""
        error = np.atleast_1d(np.asarray(error, dtype=float))  # (1 or N,)
        rows = max(len(self.table), len(error))
        table = np.repeat(self.table, rows, axis=0) if len(self.table) < rows else self.table.copy()
        table[:, frame, PARAMETER_KINDS.index(kind)] += error
        return replace(self, table=table)

    def entry_of_joint(self, joint: int) -> int:
        """Where `vector` has what `add_joint_error` adds to."""
        kind = "theta" if self.robot.joints[joint].is_revolute else "d"
        return joint * len(PARAMETER_KINDS) + PARAMETER_KINDS.index(kind)

    def add_joint_error(self, joint: int, error: ArrayLike) -> RobotState:
        """Add to where a joint stands: rad, or mm for a prismatic joint; a scalar or (N,)."""
        kind = "theta" if self.robot.joints[joint].is_revolute else "d"
        return self.add_link_error(joint, kind, error)

    def turn_base(self, rotvec_rad: ArrayLike) -> RobotState:
        """Turn the whole arm about the base's origin: (3,) or (N, 3)."""
        return replace(self, base_rotvec_rad=self.base_rotvec_rad + np.atleast_2d(np.asarray(rotvec_rad, float)))

    def displace(self, displacement_mm: ArrayLike) -> RobotState:
        """Move the target in the base frame: (3,) or (N, 3)."""
        return replace(self, displacement_mm=self.displacement_mm + np.atleast_2d(np.asarray(displacement_mm, float)))

    def displace_in_scanner(self, displacement_mm: ArrayLike) -> RobotState:
        """Move what the scanner reports, in its own frame: (N, 3). Nothing moves where nothing was measured."""
        if self.seen is None:
            return self
        base_R_scanner = np.swapaxes(self.seen.scanner_T_base[:, :3, :3], 1, 2)
        moved_mm = np.einsum("nij,nj->ni", base_R_scanner, np.asarray(displacement_mm, float))
        # What is reported moves as if the target did; a scanner on the flange would itself move the other way.
        return self.displace(-moved_mm if self.robot.carries_scanner else moved_mm)

    def turn_in_scanner(self, rotvec_rad: ArrayLike) -> RobotState:
        """Turn what the scanner reports about the target itself, in the scanner's frame: (N, 3), small.

        No point moves; only a measured orientation shows it.
        """
        if self.seen is None:
            return self
        base_R_scanner = np.swapaxes(self.seen.scanner_T_base[:, :3, :3], 1, 2)
        turn = np.einsum("nij,nj->ni", base_R_scanner, np.asarray(rotvec_rad, float))
        return replace(self, target_rotvec_rad=self.target_rotvec_rad + turn)

    @cached_property
    def chain(self) -> kinematics.Chain:
        """The forward pass at this state, the base's turn left out: effects read where axes and links are."""
        return kinematics.forward(self.table, self.poses.q, self.robot.is_revolute, self.robot.base_T_first)

    @property
    def loaded(self) -> RobotState:
        """The state at which loads are worked out: the first that an effect asked for, unless the model fixed another.

        States that come of this one share it. Deflections of 1e-3 rad change a torque by 1e-3 of itself, so working it
        out anew after every joint's deflection would cost much and change nothing that can be measured.
        """
        if not self._loaded:
            self._loaded.append(self)
        return self._loaded[0]

    @cached_property
    def gravity(self) -> GravityLoads:
        """What gravity does to the arm at this state, by the masses of robot.toml and the poses' payload."""
        return GravityLoads(self.robot, self.chain, self.poses.payload_kg)

    @property
    def gravity_torques_nm(self) -> Array:
        """(N, n) gravity's torque about each joint (N for a prismatic one)."""
        return self.gravity.joint_torques

    def place(self, points_mm: Array) -> Array:
        """From where the chain puts points (N, 3) to where they are: the base's turn, then the displacement."""
        if np.any(self.base_rotvec_rad):
            turn = frames.rotation_from_rotvec(self.base_rotvec_rad)
            points_mm = np.einsum("nij,nj->ni", np.broadcast_to(turn, (len(points_mm), 3, 3)), points_mm)
        return points_mm + self.displacement_mm

    @property
    def base_T_flange(self) -> Array:
        """(N, 4, 4) the flange where it is: as the chain has it, with the base's turn and the displacement."""
        turn = frames.rotation_from_rotvec(self.base_rotvec_rad)
        moved = frames.make_transform(turn, self.displacement_mm)
        return np.asarray(moved @ self.chain.base_T_flange)

    @property
    def attitude(self) -> Array:
        """(N, 3, 3) base_R_tool: the chain's, the base's turn and the target's own.

        Of an arm that carries the scanner flange_R_base: how the room stands, seen from the flange.
        """
        if self.robot.carries_scanner:
            into_chain = np.swapaxes(frames.rotation_from_rotvec(self.base_rotvec_rad), 1, 2)
            turned = frames.rotation_from_rotvec(self.target_rotvec_rad)
            return np.asarray(np.swapaxes(self.chain.base_T_flange[:, :3, :3], 1, 2) @ into_chain @ turned)
        out = self.chain.base_T_frame[:, -1, :3, :3]
        for rotvec in (self.base_rotvec_rad, self.target_rotvec_rad):
            if np.any(rotvec):
                out = frames.rotation_from_rotvec(rotvec) @ out
        return out
