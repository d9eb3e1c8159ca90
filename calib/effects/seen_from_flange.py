"""What a scanner on the flange sees of targets in the room, in the flange's frame, and the derivative by the state.

    y = R^T (W^T (p - d) - t)

with the chain's flange (R, t), the base's turn W, the displacement d of what the flange carries, and the target's place
p in the base frame.
"""

from __future__ import annotations

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.effects.state import RobotState
from calib.kinematics import chain as kinematics


def room_target(state: RobotState, target: str) -> Array:
    """A target's position (N, 3), mm in the flange's frame."""
    return kinematics.seen_from_flange(state.chain, _in_chain(state, target)[0])[0]


def room_target_by_state(state: RobotState, target: str) -> tuple[Array, Array]:
    """The target in the room (`room_target`) with its derivative by `state.vector` (N, 3, S)."""
    in_chain_mm, into_chain = _in_chain(state, target)
    seen_mm, by_table, by_place = kinematics.seen_from_flange(state.chain, in_chain_mm)
    by_place = by_place @ into_chain
    beside_mm = state.target_offsets_mm[target] - state.displacement_mm
    # d exp(w)^T u / dw = exp(w)^T skew(u) J(w), J as in `calib.fitting.model.point_by_state`
    by_turn = by_place @ frames.skew(beside_mm) @ (np.eye(3) + 0.5 * frames.skew(state.base_rotvec_rad))
    still = np.zeros_like(by_place)  # a turn of the target about its own point moves no point
    offsets = [by_place if name == target else still for name in state.target_offsets_mm]
    by_table = by_table.reshape(*by_table.shape[:2], -1)
    return seen_mm, np.concatenate([by_table, by_turn, -by_place, still, *offsets], axis=-1)


def room_turn_by_state(state: RobotState) -> Array:
    """The small turn of the room about the flange's axes, rad, by `state.vector` (N, 3, S): of `state.attitude`."""
    by_table = kinematics.flange_turn_jacobian(state.chain)
    by_table = by_table.reshape(*by_table.shape[:2], -1)
    into_chain = np.swapaxes(frames.rotation_from_rotvec(state.base_rotvec_rad), 1, 2)
    flange_R_base = np.swapaxes(state.chain.base_T_flange[:, :3, :3], 1, 2) @ into_chain
    by_base = -flange_R_base @ (np.eye(3) + 0.5 * frames.skew(state.base_rotvec_rad))
    by_target = flange_R_base @ (np.eye(3) + 0.5 * frames.skew(state.target_rotvec_rad))
    still = np.zeros_like(flange_R_base)
    offsets = [still for _ in state.target_offsets_mm]
    return np.concatenate([by_table, by_base, still, by_target, *offsets], axis=-1)


def _in_chain(state: RobotState, target: str) -> tuple[Array, Array]:
    """Where the chain has a target, its base not turned, its flange not displaced (N, 3), and W^T (1 or N, 3, 3)."""
    into_chain = np.swapaxes(frames.rotation_from_rotvec(state.base_rotvec_rad), 1, 2)
    beside_mm = state.target_offsets_mm[target] - state.displacement_mm
    out = (into_chain @ beside_mm[:, :, None])[..., 0]
    return np.broadcast_to(out, (len(state.poses), 3)), into_chain
