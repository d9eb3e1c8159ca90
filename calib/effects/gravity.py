"""Gravity on the arm: torques about the joints and moments on the links, from where the masses hang.

    tau_j = z_j . sum_k (c_k - o_j) x m_k g        (N m; for a prismatic joint the force z_j . sum m_k g, N)

with z_j, o_j axis and origin of joint j, c_k the centres of mass of everything beyond it. Where masses are not known,
the torque that one kilogram at each frame's origin would cause stands in: masses along a link between two origins are
a sum of masses at them, so these columns span what the true masses do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.kinematics.robot import Robot

if TYPE_CHECKING:
    from calib.effects.state import RobotState  # which calls this module

Array = NDArray[np.float64]


def has_masses(robot: Robot) -> bool:
    """Whether the robot's table tells mass and centre of mass of every link."""
    return all(joint.mass_kg is not None and joint.com_mm is not None for joint in robot.joints)


def hanging_masses(state: RobotState) -> list[tuple[int, Array, Array]]:
    """What hangs on the arm, payload included: (frame that carries it, mass (1 or N,) kg, place (N, 3) mm)."""
    robot, base_T_frame = state.robot, state.chain.base_T_frame
    out = []
    for k, joint in enumerate(robot.joints):
        if joint.mass_kg:
            out.append(
                (
                    k + 1,
                    np.array([joint.mass_kg]),
                    _at(base_T_frame[:, k + 1], joint.com_mm or (0.0, 0.0, 0.0)),
                )
            )
    tool, flange = robot.tool, state.chain.base_T_flange
    if tool.mass_kg:
        out.append((robot.n_joints, np.array([tool.mass_kg]), _at(flange, tool.com_mm or (0.0, 0.0, 0.0))))
    if state.poses.payload_kg is not None and np.any(state.poses.payload_kg):
        out.append((robot.n_joints, state.poses.payload_kg, payload_place(state)))
    return out


def payload_place(state: RobotState) -> Array:
    """Centre of mass of the payload (N, 3): where robot.toml says, else the tool point."""
    com = state.robot.tool.payload_com_mm
    return _at(state.chain.base_T_flange, com) if com is not None else state.chain.target_mm


def _at(base_T_frame: Array, point_mm: tuple[float, float, float]) -> Array:
    return base_T_frame[:, :3, :3] @ np.array(point_mm) + base_T_frame[:, :3, 3]


def carried(state: RobotState) -> tuple[Array, Array]:
    """All that hangs at a frame 0 ... n + 1 or beyond: mass (n + 2, N) kg, mass times place (n + 2, N, 3) kg mm."""
    shape = (state.robot.n_joints + 2, len(state.poses))
    mass, first_moment = np.zeros(shape), np.zeros((*shape, 3))
    for frame, mass_kg, place_mm in hanging_masses(state):
        mass[frame] += mass_kg
        first_moment[frame] += mass_kg[:, None] * place_mm
    return np.cumsum(mass[::-1], axis=0)[::-1], np.cumsum(first_moment[::-1], axis=0)[::-1]


def moment_about(state: RobotState, origin_mm: Array, beyond: int) -> Array:
    """Gravity's moment (N, 3) in N m about a point (N, 3), of what frames after `beyond` carry; base frame."""
    mass, first_moment = (of_frame[beyond + 1] for of_frame in state.carried)
    lever = (first_moment - mass[:, None] * origin_mm) * 1e-3  # (N, 3) kg m
    return np.asarray(lever @ frames.skew(state.robot.gravity_m_s2))  # each row lever x g


def joint_torques(state: RobotState) -> Array:
    """(N, n) gravity's torque about each revolute axis, N m, and force along each prismatic one, N."""
    base_T_frame, gravity = state.chain.base_T_frame, np.array(state.robot.gravity_m_s2)
    out = np.zeros((len(state.poses), state.robot.n_joints))
    for j, joint in enumerate(state.robot.joints):
        axis, origin = base_T_frame[:, j, :3, 2], base_T_frame[:, j, :3, 3]
        if joint.is_revolute:
            out[:, j] = np.sum(axis * moment_about(state, origin, j), axis=1)
        else:
            out[:, j] = (axis @ gravity) * state.carried[0][j + 1]
    return out


def bending(state: RobotState, link: int) -> tuple[Array, Array]:
    """A cantilever with L / EI = 1 rad/Nm: turn of the link's end (N, 3) rad, its frame; shift (N, 3) mm, base frame.

    With M0 and ML the moments across the link at its root and end of all beyond it, M1 that of its own weight at the
    root, e its direction and L its length, the end turns by (M0 + ML) / 2 + M1 / 3 and moves by
    L (M0 / 3 + ML / 6 + M1 / 4) x e (Euler-Bernoulli).
    """
    base_T_frame = state.chain.base_T_frame
    root_mm, end = base_T_frame[:, link, :3, 3], base_T_frame[:, link + 1]
    span_mm = end[:, :3, 3] - root_mm
    length_mm = np.linalg.norm(span_mm, axis=1, keepdims=True)
    along = span_mm / np.maximum(length_mm, 1.0)  # a link without length does not bend

    def across(moment: Array) -> Array:
        return np.asarray(moment - np.sum(moment * along, axis=1, keepdims=True) * along)

    at_root = across(moment_about(state, root_mm, link + 1))
    at_end = across(moment_about(state, end[:, :3, 3], link + 1))
    weight_n = (state.robot.joints[link].mass_kg or 0.0) * np.array(state.robot.gravity_m_s2)
    own = np.cross(0.5e-3 * span_mm, weight_n)
    bends = length_mm >= 1.0
    turn = bends * ((at_root + at_end) / 2.0 + own / 3.0)
    shift_mm = bends * length_mm * np.cross(at_root / 3.0 + at_end / 6.0 + own / 4.0, along)
    return np.einsum("nji,nj->ni", end[:, :3, :3], turn), shift_mm


def unit_torques(state: RobotState, joint: int) -> Array:
    """(N, K) torque about a joint of 1 kg at the origin of each frame beyond it, and at the tool point: N m per kg."""
    base_T_frame, gravity = state.chain.base_T_frame, np.array(state.robot.gravity_m_s2)
    axis, origin = base_T_frame[:, joint, :3, 2], base_T_frame[:, joint, :3, 3]
    if not state.robot.joints[joint].is_revolute:
        return (axis @ gravity)[:, None]
    places = base_T_frame[:, joint + 1 :, :3, 3] - origin[:, None]  # (N, K, 3)
    return np.asarray(np.einsum("ni,nki->nk", axis, np.cross(places * 1e-3, gravity)))


def payload_torque(state: RobotState, joint: int) -> Array:
    """(N,) torque of the payload alone about a joint, N m (a force, N, along a prismatic one)."""
    base_T_frame, gravity = state.chain.base_T_frame, np.array(state.robot.gravity_m_s2)
    axis, origin = base_T_frame[:, joint, :3, 2], base_T_frame[:, joint, :3, 3]
    if state.poses.payload_kg is None:
        return np.zeros(len(axis))
    if not state.robot.joints[joint].is_revolute:
        return np.asarray((axis @ gravity) * state.poses.payload_kg)
    moment = np.cross((payload_place(state) - origin) * 1e-3, gravity) * state.poses.payload_kg[:, None]
    return np.asarray(np.einsum("ni,ni->n", axis, moment))
