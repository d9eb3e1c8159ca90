"""Gravity on the arm: torques about the joints and moments on the links, from masses and centres of mass.

    tau_j = z_j . sum_k (c_k - o_j) x m_k g        (N m; for a prismatic joint the force z_j . sum m_k g, N)

with z_j, o_j axis and origin of joint j, c_k the centres of mass of everything beyond it. Where masses are not known,
the torques of one kilogram at each frame's origin are used: a mass along a link between two origins acts as a sum of
masses at them, so these columns span what the true masses do. Where a joint's torque was measured, that is its load
(`Robot.measured_loads`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

import calib.frames as frames
from calib.array_types import Array
from calib.kinematics.chain import Chain
from calib.kinematics.robot import Robot
from calib.kinematics.statics import TorqueReading, load_torque


def has_masses(robot: Robot) -> bool:
    """Whether the robot has mass and centre of mass of every link."""
    return all(joint.mass_kg is not None and joint.com_mm is not None for joint in robot.joints)


def tells_tool_mass(robot: Robot, payload_kg: Array | None) -> bool:
    """Whether robot.toml, or the payload at any pose, tells a mass at the flange."""
    return bool(robot.tool.mass_kg) or (payload_kg is not None and bool(np.any(payload_kg)))


def loaded_joints(robot: Robot) -> tuple[int, ...]:
    """Joints, counted from 0, whose load is known: all where the links' masses are, else those of measured torque."""
    known = range(robot.n_joints) if has_masses(robot) else (load.joint for load in robot.measured_loads)
    return tuple(sorted(known))


@dataclass(frozen=True)
class GravityLoads:
    """Gravity loads of an arm at N poses. Points, axes and moments are in the base frame."""

    robot: Robot
    chain: Chain  # the forward pass with its axes and links
    payload_kg: Array | None  # (N,)
    readings: Mapping[int, TorqueReading] = field(default_factory=dict)  # measured torques, by joint

    @cached_property
    def _gravity_m_s2(self) -> Array:
        return np.array(self.robot.gravity_m_s2)

    @property
    def _hanging(self) -> list[tuple[int, Array, Array]]:
        """Masses on the arm, payload included: number of the carrying frame, mass (1 or N,) kg, and place (N, 3) mm."""
        robot, base_T_frame = self.robot, self.chain.base_T_frame
        hanging = []
        for k, joint in enumerate(robot.joints):
            if joint.mass_kg:
                place_mm = _at(base_T_frame[:, k + 1], joint.com_mm or (0.0, 0.0, 0.0))
                hanging.append((k + 1, np.array([joint.mass_kg]), place_mm))
        if robot.tool.mass_kg:
            place_mm = _at(self.chain.base_T_flange, robot.tool.com_mm or (0.0, 0.0, 0.0))
            hanging.append((robot.n_joints, np.array([robot.tool.mass_kg]), place_mm))
        if self.payload_kg is not None and np.any(self.payload_kg):
            hanging.append((robot.n_joints, self.payload_kg, self._payload_mm))
        return hanging

    @property
    def _payload_mm(self) -> Array:
        """Centre of mass (N, 3), mm, of the payload, by robot.toml, else at the tool point."""
        com_mm = self.robot.tool.payload_com_mm
        return _at(self.chain.base_T_flange, com_mm) if com_mm is not None else self.chain.target_mm

    @cached_property
    def carried(self) -> tuple[Array, Array]:
        """Mass (n + 2, N) kg, and mass times place (n + 2, N, 3) kg mm, carried at or beyond each frame 0 ... n + 1."""
        shape = (self.robot.n_joints + 2, len(self.chain.base_T_frame))
        mass, first_moment = np.zeros(shape), np.zeros((*shape, 3))
        for frame, mass_kg, place_mm in self._hanging:
            mass[frame] += mass_kg
            first_moment[frame] += mass_kg[:, None] * place_mm
        return np.cumsum(mass[::-1], axis=0)[::-1], np.cumsum(first_moment[::-1], axis=0)[::-1]

    def moment_about(self, origin_mm: Array, beyond: int) -> Array:
        """Gravity's moment (N, 3), N m, about points (N, 3), by all masses on the frames beyond a given one."""
        mass, first_moment = (of_frame[beyond + 1] for of_frame in self.carried)
        lever = (first_moment - mass[:, None] * origin_mm) * 1e-3  # (N, 3) kg m
        return lever @ frames.skew(self.robot.gravity_m_s2)  # each row lever x g

    @cached_property
    def joint_torques(self) -> Array:
        """Gravity's torque about each revolute axis, N m, and force along each prismatic one, N: (N, n).

        For a joint whose torque was measured, the load that this tells.
        """
        torques = np.zeros((len(self.chain.base_T_frame), self.robot.n_joints))
        for j, joint in enumerate(self.robot.joints):
            axis, origin_mm = self._axis(j)
            load = self.robot.measured_load(j)
            if load is not None:
                torques[:, j] = load_torque(self.robot, self.chain, load, self.payload_kg, self.readings.get(j))
            elif joint.is_revolute:
                torques[:, j] = np.sum(axis * self.moment_about(origin_mm, j), axis=1)
            else:
                torques[:, j] = (axis @ self._gravity_m_s2) * self.carried[0][j + 1]
        return torques

    def unit_torques(self, joint: int) -> Array:
        """Torque about a joint by 1 kg at the origin of each frame beyond it, and at the tool point: (N, K) N m per kg.

        For a prismatic joint the force along it of 1 kg, wherever that hangs: (N, 1) N per kg.
        """
        axis, origin_mm = self._axis(joint)
        if not self.robot.joints[joint].is_revolute:
            return (axis @ self._gravity_m_s2)[:, None]
        lever_mm = self.chain.base_T_frame[:, joint + 1 :, :3, 3] - origin_mm[:, None]  # (N, K, 3)
        return np.einsum("ni,nki->nk", axis, np.cross(lever_mm * 1e-3, self._gravity_m_s2))

    def held_torque(self, joint: int) -> Array:
        """Torque about a revolute joint by 1 kg held where the payload is: (N,) N m per kg."""
        axis, origin_mm = self._axis(joint)
        return np.sum(axis * np.cross((self._payload_mm - origin_mm) * 1e-3, self._gravity_m_s2), axis=1)

    def payload_torque(self, joint: int) -> Array:
        """Torque of the payload alone about a joint: (N,) N m, or the force along a prismatic one, N."""
        axis, origin_mm = self._axis(joint)
        if self.payload_kg is None:
            return np.zeros(len(axis))
        if not self.robot.joints[joint].is_revolute:
            return (axis @ self._gravity_m_s2) * self.payload_kg
        return np.einsum("ni,ni->n", axis, self.payload_moment_about(origin_mm))

    def payload_moment_about(self, origin_mm: Array) -> Array:
        """Moment of the payload alone about points (3,) or (N, 3): (N, 3) N m."""
        lever_mm = self._payload_mm - origin_mm
        payload_kg = np.zeros(len(lever_mm)) if self.payload_kg is None else self.payload_kg
        return np.cross(lever_mm * 1e-3, self._gravity_m_s2) * payload_kg[:, None]

    @cached_property
    def unit_moments(self) -> Array:
        """Moment about the base's origin of 1 kg at each frame and at the tool point: (N, K, 3) N m per kg."""
        return np.cross(self.chain.base_T_frame[:, 1:, :3, 3] * 1e-3, self._gravity_m_s2)

    @cached_property
    def unit_bendings(self) -> list[tuple[Array, Array]]:
        """Turns and shifts of each link's end under masses of 1 kg (`unit_bending`)."""
        return [self.unit_bending(link) for link in range(self.robot.n_joints)]

    def unit_bending(self, link: int) -> tuple[Array, Array]:
        """Turn and shift of a link's end under 1 kg at each frame from there on and at the tool point: (N, K, 3)."""
        base_T_frame = self.chain.base_T_frame
        places_mm = base_T_frame[:, link + 1 :, :3, 3]  # (N, K, 3)
        at_root, at_end = (
            np.cross((places_mm - base_T_frame[:, None, frame, :3, 3]) * 1e-3, self._gravity_m_s2)
            for frame in (link, link + 1)
        )
        bent = [self._bent(link, at_root[:, k], at_end[:, k]) for k in range(places_mm.shape[1])]
        return np.stack([turn for turn, _ in bent], axis=1), np.stack([shift for _, shift in bent], axis=1)

    def payload_bending(self, link: int) -> tuple[Array, Array]:
        """Turn (N, 3) rad and shift (N, 3) mm of a link's end under the payload alone."""
        at_root, at_end = (
            self.payload_moment_about(self.chain.base_T_frame[:, frame, :3, 3]) for frame in (link, link + 1)
        )
        return self._bent(link, at_root, at_end)

    @cached_property
    def bendings(self) -> list[tuple[Array, Array]]:
        """Turn and shift of each link's end under all masses (`bending`)."""
        return [self.bending(link) for link in range(self.robot.n_joints)]

    def bending(self, link: int) -> tuple[Array, Array]:
        """Turn (N, 3) rad, link frame, and shift (N, 3) mm of a link's end for a compliance L / EI = 1 rad/Nm.

        With M0 and ML the moments across the link at its root and end of all beyond it, M1 that of its own weight at
        the root, e its direction and L its length, the end turns by (M0 + ML) / 2 + M1 / 3 and moves by
        L (M0 / 3 + ML / 6 + M1 / 4) x e (Euler-Bernoulli).
        """
        base_T_frame = self.chain.base_T_frame
        root_mm, end_mm = base_T_frame[:, link, :3, 3], base_T_frame[:, link + 1, :3, 3]
        at_root = self.moment_about(root_mm, link + 1)
        at_end = self.moment_about(end_mm, link + 1)
        weight_n = (self.robot.joints[link].mass_kg or 0.0) * self._gravity_m_s2
        own = np.cross(0.5e-3 * (end_mm - root_mm), weight_n)
        return self._bent(link, at_root, at_end, own)

    def _bent(self, link: int, at_root: Array, at_end: Array, own: Array | None = None) -> tuple[Array, Array]:
        """Turn and shift of a link's end under moments (N, 3) at its root and end and its own weight's moment."""
        base_T_frame = self.chain.base_T_frame
        root_mm, end = base_T_frame[:, link, :3, 3], base_T_frame[:, link + 1]
        span_mm = end[:, :3, 3] - root_mm
        length_mm = np.linalg.norm(span_mm, axis=1, keepdims=True)
        along = span_mm / np.maximum(length_mm, 1.0)  # a link without length does not bend

        def across(moment: Array) -> Array:
            return moment - np.sum(moment * along, axis=1, keepdims=True) * along

        at_root, at_end = across(at_root), across(at_end)
        own = np.zeros_like(span_mm) if own is None else own
        bends = length_mm >= 1.0
        turn = bends * ((at_root + at_end) / 2.0 + own / 3.0)
        shift_mm = bends * length_mm * np.cross(at_root / 3.0 + at_end / 6.0 + own / 4.0, along)
        return np.einsum("nji,nj->ni", end[:, :3, :3], turn), shift_mm

    def _axis(self, joint: int) -> tuple[Array, Array]:
        """Unit vector along a joint's axis (N, 3), and a point on it (N, 3) mm."""
        return self.chain.base_T_frame[:, joint, :3, 2], self.chain.base_T_frame[:, joint, :3, 3]


def _at(base_T_frame: Array, point_mm: tuple[float, float, float]) -> Array:
    """Base-frame position (N, 3), mm, of a point that is fixed in a frame (N, 4, 4)."""
    return base_T_frame[:, :3, :3] @ np.array(point_mm) + base_T_frame[:, :3, 3]
