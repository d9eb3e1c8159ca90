"""Inverse problem of a correction: joints with which the calibrated arm's tool meets the nominal tool frame.

    e = [p_goal - p; L sin(turn)]

with the remaining turn and the arm's reach L, so that rows and columns are all millimetres. The derivative neglects how
effects change with q: `calib.kinematics.inverse` needs it approximately only, and e is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.effects.state import RobotState
from calib.fitting.model import Model, target_in_chain
from calib.kinematics import chain as kinematics
from calib.kinematics.inverse import Preference
from calib.kinematics.robot import TOOL_POINT


@dataclass(frozen=True)
class ToolProblem:
    """Inverse problem for N tool goals, solved with the calibrated arm's model."""

    model: Model
    x: Array
    conditions: Poses
    goal: Array  # (N, 4, 4) base_T_tool of the nominal arm
    with_orientation: bool
    measured_point: bool = False  # whether the tool's place is that of its measured point, not the end of its row

    @property
    def length_mm(self) -> float:
        """Arm's reach, mm, which converts radians to millimetres in errors and derivatives."""
        table = self.model.robot.table
        return max(float(np.sum(np.hypot(table[:, 0], table[:, 2]))), 1.0)

    @property
    def joint_units(self) -> Array:
        """Size (n,) of one scaled unit of each joint: rad, or the reach in mm for a prismatic joint."""
        return np.where(self.model.robot.is_revolute, 1.0, self.length_mm)

    def _state(self, q: Array, rows: IndexArray) -> tuple[RobotState, Array]:
        """Robot state of the calibrated arm at q (K, n), and its base's rotation (1 or K, 3, 3)."""
        state = self.model.state(self.x, replace(self.conditions.select(rows), q=q))
        return state, frames.rotation_from_rotvec(state.base_rotvec_rad)

    def _point_mm(self, state: RobotState) -> Array:
        """Position of the tool (K, 3), mm, in the frame of the chain's base."""
        return target_in_chain(state, TOOL_POINT) if self.measured_point else state.chain.target_mm

    def _tool(self, state: RobotState, turn: Array) -> Array:
        """Transform base_T_tool (K, 4, 4), including the base's turn and tool displacements by effects."""
        rotation = turn @ state.chain.base_T_frame[:, -1, :3, :3]
        return frames.make_transform(rotation, state.place(self._point_mm(state)))

    def _error(self, base_T_tool: Array, rows: IndexArray) -> Array:
        goal = self.goal[rows]
        position = goal[:, :3, 3] - base_T_tool[:, :3, 3]
        if not self.with_orientation:
            return position
        return np.concatenate([position, self.length_mm * _turn_vector(base_T_tool, goal)], axis=1)

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """Error (K, 3 or 6), mm, of some targets, goal minus position, and its derivative by the scaled joints.

        Rows 4 to 6 are the remaining turn, times the reach.
        """
        state, turn = self._state(q, rows)
        moved, axes = kinematics.joint_jacobian(state.chain, self.model.robot.is_revolute, self._point_mm(state))
        jacobian = turn @ moved
        if self.with_orientation:
            jacobian = np.concatenate([jacobian, self.length_mm * (turn @ axes)], axis=1)
        return self._error(self._tool(state, turn), rows), jacobian * self.joint_units

    def of(self, rows: IndexArray) -> ToolProblem:
        """Inverse problem restricted to some of the tool goals."""
        return replace(self, goal=self.goal[rows], conditions=self.conditions.select(rows))

    def attitude_left(self, weight: float) -> Preference | None:
        """Secondary objective for redundant motion: the tool's remaining rotation times a weight; None if unused."""

        def left(q: Array, rows: IndexArray) -> tuple[Array, Array]:
            state, turn = self._state(q, rows)
            axes = turn @ kinematics.joint_jacobian(state.chain, self.model.robot.is_revolute)[1]
            turned = _turn_vector(self._tool(state, turn), self.goal[rows])
            return weight * turned, weight * axes * self.joint_units

        return left if weight > 0.0 else None

    def errors(self, q: Array) -> tuple[Array, Array]:
        """Position error (N,), mm, and orientation error (N,), rad, also where only positions are to be met."""
        at = self._tool(*self._state(q, np.arange(len(q))))
        position = np.linalg.norm(self.goal[:, :3, 3] - at[:, :3, 3], axis=1)
        sine = np.linalg.norm(_turn_vector(at, self.goal), axis=1)
        cosine = 0.5 * (np.einsum("nij,nij->n", at[:, :3, :3], self.goal[:, :3, :3]) - 1.0)
        return position, np.arctan2(sine, cosine)


def _turn_vector(at: Array, goal: Array) -> Array:
    """Rotation from one orientation to a goal (N, 3), as sin(angle) times axis, in the base frame."""
    return 0.5 * np.sum(np.cross(at[:, :3, :3], goal[:, :3, :3], axis=1), axis=-1)
