"""The robot's state at every pose, which effects change before the forward pass, and the conditions of the poses.

Where the arm carries the scanner, a target that is fixed in the world is seen from the flange at

    y = R^T (W^T (p - d) - t)

with the chain's flange (R, t), the base's turn W, the displacement d of what the flange carries, and the target's
position p in the base frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

import calib.frames as frames
from calib.array_types import Array
from calib.brief import Brief
from calib.dataset.dataset import Poses
from calib.dataset.further_columns import is_number
from calib.dataset.input_names import CONDITIONS
from calib.dataset.signals import drive_inputs, link_angle_rad, measured_torque_nm
from calib.effects.gravity import GravityLoads
from calib.errors import FitError
from calib.kinematics import chain as kinematics
from calib.kinematics.drive import turn_by_encoder, turn_by_law
from calib.kinematics.robot import PARAMETER_KINDS, LinkEncoder, Robot
from calib.kinematics.statics import TorqueReading


@dataclass(frozen=True)
class Seen(Brief):
    """Measured positions of the target in the scanner's frame, and that frame, at each of N poses."""

    scanner_mm: Array  # (N, 3) measured, in the scanner's frame
    scanner_T_base: Array  # (N, 4, 4) by an earlier fit


@dataclass(frozen=True)
class RobotState(Brief):
    """Robot, poses, table and displacements that determine the target's position at each of N poses.

    Arrays have a leading axis of 1 until something depends on the pose.
    """

    robot: Robot
    poses: Poses
    table: Array  # (1 or N, n + 1, 5) rows a, alpha, d, theta, beta
    base_rotvec_rad: Array  # (1 or N, 3) turn of the whole arm about the base's origin
    displacement_mm: Array  # (1 or N, 3) of what the flange carries, base frame, after everything else
    target_offsets_mm: Mapping[str, Array] = field(default_factory=dict)  # further targets, in their link's frame, (3,)
    seen: Seen | None = None
    target_rotvec_rad: Array = field(
        default_factory=lambda: np.zeros((1, 3))
    )  # turn about the target itself, base frame
    _loaded: list[RobotState] = field(default_factory=list, compare=False, repr=False)  # see `loaded`

    @classmethod
    def nominal(cls, robot: Robot, poses: Poses, seen: Seen | None = None) -> RobotState:
        """State of the nominal robot at N poses; links with an encoder of their own stand where that reads."""
        offsets = {target.name: np.array(target.xyz_mm) for target in robot.targets}
        state = cls(robot, poses, robot.table[None], np.zeros((1, 3)), np.zeros((1, 3)), offsets, seen)
        for encoder in robot.link_encoders:
            state = state.add_joint_error(encoder.joint, _turn_of_link(robot, encoder, poses))
        return state

    def with_loads_at(self, loaded: RobotState) -> RobotState:
        """This robot state with its gravity loads computed at another state."""
        return replace(self, _loaded=[loaded])

    def with_masses_of(self, robot: Robot, poses: Poses) -> RobotState:
        """This robot state with the masses of another robot and the payload of other poses at equal joint positions."""
        state = replace(self, robot=robot, poses=poses)
        state.__dict__["chain"] = self.chain  # masses do not move it
        return state

    @property
    def q_rad(self) -> Array:
        """Commanded joint positions (N, n) rad; mm for prismatic joints."""
        return self.poses.q

    @property
    def previous_q_rad(self) -> Array:
        """Commanded joint positions (N, n), rad or mm, of the pose measured before each; its own for the first.

        Poses that come after all that were measured, such as targets, have their own too.
        """
        return self.poses.came_from

    @property
    def link_q_rad(self) -> Array:
        """Positions (N, n), rad or mm, at which the links stand by their own encoders; as commanded without these.

        Where an encoder was not read, the laws that its other readings tell stand in.
        """
        turned = self.poses.q.copy()
        for encoder in self.robot.link_encoders:
            turned[:, encoder.joint] += _turn_of_link(self.robot, encoder, self.poses)
        return turned

    def column(self, name: str) -> Array:
        """Numbers (N,) of a column of poses.csv, by its name there: "temperature_motor2_c", "load_left_q3_deg".

        Raises FitError where the poses do not have it, or words in it.
        """
        values = getattr(self.poses, name) if name in CONDITIONS else self.poses.extra.by_name.get(name)
        if values is None:
            raise FitError(f"column {name!r} is needed; give it for each pose, as poses.csv does")
        if not is_number(np.asarray(values)):
            raise FitError(f"column {name!r} holds words, numbers are needed")
        return np.array(values, dtype=float)

    @cached_property
    def vector(self) -> Array:
        """State as a vector per pose (1 or N, S): table, base turn, displacement, target's turn, target offsets.

        S = 5 (n + 1) + 9 + 3 T.
        """
        turns = [self.base_rotvec_rad, self.displacement_mm, self.target_rotvec_rad]
        offsets = [np.atleast_2d(offset_mm) for offset_mm in self.target_offsets_mm.values()]
        parts = [self.table.reshape(len(self.table), -1), *turns, *offsets]
        rows = max(map(len, parts))
        return np.concatenate([np.broadcast_to(p, (rows, p.shape[1])) for p in parts], axis=1)

    def add_link_error(self, frame: int, kind: str, error: ArrayLike) -> RobotState:
        """Robot state with an error, a scalar or (N,), added to one entry of the table; frame n is the tool row."""
        error = np.atleast_1d(np.asarray(error, dtype=float))  # (1 or N,)
        rows = max(len(self.table), len(error))
        table = np.repeat(self.table, rows, axis=0) if len(self.table) < rows else self.table.copy()
        table[:, frame, PARAMETER_KINDS.index(kind)] += error
        return replace(self, table=table)

    def entry_of_joint(self, joint: int) -> int:
        """Index in `vector` of a joint's theta (or d of a prismatic joint), to which joint errors are added."""
        kind = "theta" if self.robot.joints[joint].is_revolute else "d"
        return joint * len(PARAMETER_KINDS) + PARAMETER_KINDS.index(kind)

    def add_joint_error(self, joint: int, error: ArrayLike) -> RobotState:
        """Robot state with an error added to a joint's position: rad, or mm for a prismatic joint; a scalar or (N,)."""
        kind = "theta" if self.robot.joints[joint].is_revolute else "d"
        return self.add_link_error(joint, kind, error)

    def turn_base(self, rotvec_rad: ArrayLike) -> RobotState:
        """Robot state with the whole arm turned about the base's origin: rotation vectors (3,) or (N, 3) rad."""
        return replace(self, base_rotvec_rad=self.base_rotvec_rad + np.atleast_2d(np.asarray(rotvec_rad, float)))

    def displace(self, displacement_mm: ArrayLike) -> RobotState:
        """Robot state with the target displaced in the base frame: (3,) or (N, 3) mm."""
        return replace(self, displacement_mm=self.displacement_mm + np.atleast_2d(np.asarray(displacement_mm, float)))

    def displace_in_scanner(self, displacement_mm: ArrayLike) -> RobotState:
        """Robot state with reported points displaced by (N, 3) mm, scanner frame; unchanged without measured points."""
        if self.seen is None:
            return self
        base_R_scanner = np.swapaxes(self.seen.scanner_T_base[:, :3, :3], 1, 2)
        moved_mm = np.einsum("nij,nj->ni", base_R_scanner, np.asarray(displacement_mm, float))
        # Reported points move as if the target did; a scanner on the flange would itself move the other way.
        return self.displace(-moved_mm if self.robot.carries_scanner else moved_mm)

    def turn_in_scanner(self, rotvec_rad: ArrayLike) -> RobotState:
        """Robot state with reported orientations turned by small rotation vectors (N, 3) rad, scanner frame.

        No point moves; only a measured orientation shows it.
        """
        if self.seen is None:
            return self
        base_R_scanner = np.swapaxes(self.seen.scanner_T_base[:, :3, :3], 1, 2)
        turn = np.einsum("nij,nj->ni", base_R_scanner, np.asarray(rotvec_rad, float))
        return replace(self, target_rotvec_rad=self.target_rotvec_rad + turn)

    @cached_property
    def chain(self) -> kinematics.Chain:
        """Forward pass of the arm's table at this state, without the base's turn and the displacement."""
        return kinematics.forward(self.table, self.poses.q, self.robot.is_revolute, self.robot.base_T_first)

    @property
    def loaded(self) -> RobotState:
        """Robot state at which gravity loads are computed: the one that first needed them, or one fixed by the model.

        States derived from this one share it. Deflections of 1e-3 rad change a torque by 1e-3 of itself, so computing
        it anew after every joint's deflection would cost much and change nothing that can be measured.
        """
        if not self._loaded:
            self._loaded.append(self)
        return self._loaded[0]

    @cached_property
    def gravity(self) -> GravityLoads:
        """Gravity loads at this state, by measured torques, the masses of robot.toml and the poses' payload."""
        poses, readings = self.poses, {}
        for load in self.robot.measured_loads:
            torque_nm = measured_torque_nm(poses, load.joint)
            if torque_nm is not None:
                approach = None if poses.approach is None else poses.approach[:, load.joint]
                readings[load.joint] = TorqueReading(torque_nm, approach)
        return GravityLoads(self.robot, self.chain, poses.payload_kg, readings)

    @property
    def gravity_torques_nm(self) -> Array:
        """Gravity's torque about each joint: (N, n) N m, or the force along a prismatic one, N."""
        return self.gravity.joint_torques

    def place(self, points_mm: Array) -> Array:
        """True base-frame positions of the chain's points (N, 3), mm, after the base's turn and the displacement."""
        if np.any(self.base_rotvec_rad):
            turn = frames.rotation_from_rotvec(self.base_rotvec_rad)
            points_mm = np.einsum("nij,nj->ni", np.broadcast_to(turn, (len(points_mm), 3, 3)), points_mm)
        return points_mm + self.displacement_mm

    @property
    def base_T_flange(self) -> Array:
        """True flange frame (N, 4, 4), including the base's turn and the displacement."""
        turn = frames.rotation_from_rotvec(self.base_rotvec_rad)
        moved = frames.make_transform(turn, self.displacement_mm)
        return moved @ self.chain.base_T_flange

    @property
    def attitude(self) -> Array:
        """Orientation base_R_tool (N, 3, 3), including the base's turn and the target's own turn.

        For an arm that carries the scanner: flange_R_base, the orientation of the world seen from the flange.
        """
        if self.robot.carries_scanner:
            into_chain = np.swapaxes(frames.rotation_from_rotvec(self.base_rotvec_rad), 1, 2)
            turned = frames.rotation_from_rotvec(self.target_rotvec_rad)
            return np.swapaxes(self.chain.base_T_flange[:, :3, :3], 1, 2) @ into_chain @ turned
        base_R_tool = self.chain.base_T_frame[:, -1, :3, :3]
        for rotvec in (self.base_rotvec_rad, self.target_rotvec_rad):
            if np.any(rotvec):
                base_R_tool = frames.rotation_from_rotvec(rotvec) @ base_R_tool
        return base_R_tool


def _turn_of_link(robot: Robot, encoder: LinkEncoder, poses: Poses) -> Array:
    """Turn (N,), rad, of a link against its motor: as its encoder reads it, or by its law where it was not read."""
    link_rad = link_angle_rad(poses, encoder.joint)
    if link_rad is None:
        return turn_by_law(robot, encoder, drive_inputs(poses, encoder.joint))
    return turn_by_encoder(link_rad, poses.q[:, encoder.joint], encoder)


def world_target(state: RobotState, target: str) -> Array:
    """Position (N, 3), mm in the flange's frame, of a target that is fixed in the world."""
    return kinematics.seen_from_flange(state.chain, _in_chain(state, target)[0])[0]


def world_target_by_state(state: RobotState, target: str) -> tuple[Array, Array]:
    """Position (N, 3), mm, of a world-fixed target in the flange's frame, and its derivative (N, 3, S) by the state."""
    in_chain_mm, chain_R_base = _in_chain(state, target)
    seen_mm, by_table, by_position = kinematics.seen_from_flange(state.chain, in_chain_mm)
    by_position = by_position @ chain_R_base
    from_flange_mm = state.target_offsets_mm[target] - state.displacement_mm
    # d exp(w)^T u / dw = exp(w)^T skew(u) J(w), J as in `calib.fitting.model.point_by_state`
    by_turn = by_position @ frames.skew(from_flange_mm) @ (np.eye(3) + 0.5 * frames.skew(state.base_rotvec_rad))
    zero = np.zeros_like(by_position)  # a turn of the target about its own point moves no point
    offsets = [by_position if name == target else zero for name in state.target_offsets_mm]
    by_table = by_table.reshape(*by_table.shape[:2], -1)
    return seen_mm, np.concatenate([by_table, by_turn, -by_position, zero, *offsets], axis=-1)


def world_turn_by_state(state: RobotState) -> Array:
    """Derivative of the world's small turn about the flange's axes (`attitude`), rad, by `state.vector` (N, 3, S)."""
    by_table = kinematics.flange_turn_jacobian(state.chain)
    by_table = by_table.reshape(*by_table.shape[:2], -1)
    chain_R_base = np.swapaxes(frames.rotation_from_rotvec(state.base_rotvec_rad), 1, 2)
    flange_R_base = np.swapaxes(state.chain.base_T_flange[:, :3, :3], 1, 2) @ chain_R_base
    by_base = -flange_R_base @ (np.eye(3) + 0.5 * frames.skew(state.base_rotvec_rad))
    by_target = flange_R_base @ (np.eye(3) + 0.5 * frames.skew(state.target_rotvec_rad))
    zero = np.zeros_like(flange_R_base)
    offsets = [zero for _ in state.target_offsets_mm]
    return np.concatenate([by_table, by_base, zero, by_target, *offsets], axis=-1)


def _in_chain(state: RobotState, target: str) -> tuple[Array, Array]:
    """Position (N, 3) of a world-fixed target before the base's turn and displacement; rotation (1 or N, 3, 3) used."""
    chain_R_base = np.swapaxes(frames.rotation_from_rotvec(state.base_rotvec_rad), 1, 2)
    from_flange_mm = state.target_offsets_mm[target] - state.displacement_mm
    in_chain_mm = (chain_R_base @ from_flange_mm[:, :, None])[..., 0]
    return np.broadcast_to(in_chain_mm, (len(state.poses), 3)), chain_R_base
