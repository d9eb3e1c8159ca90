"""Mechanism of a simulated arm: frames of all parts, the weights carried, their moments, and the base of all effects.

The chain is a product of elementary turns and shifts, written out one by one; a moment comes from each weight and its
lever. No code is shared with `calib.kinematics.chain` or the effects that a fit uses, so that each checks the other.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.errors import CalibError
from calib.kinematics.robot import Robot


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions at N poses, in the order of measuring; None for those not recorded, or no payload."""

    payload_kg: Array | None = None  # (N,)
    temperature_c: Array | None = None  # (N,)
    time_s: Array | None = None  # (N,)
    approach: Array | None = None  # (N, n) of -1, 1
    setup: NDArray[np.str_] | None = None  # (N,) which placement of the scanner

    @classmethod
    def of(cls, poses: Poses) -> Conditions:
        """Conditions recorded with poses."""
        return cls(**{field.name: getattr(poses, field.name) for field in fields(cls)})


STANDARD = Conditions()


@dataclass(frozen=True, eq=False)
class Weight:
    """A mass at every pose: the link that carries it, its centre and its weight in the base frame."""

    carrier: int  # the link that 0-based joint `carrier` moves; n for tool and payload, which hang on the last link
    place_mm: Array  # (N, 3)
    weight_n: Array  # (N, 3)

    def moment_nm(self, about_mm: Array) -> Array:
        """Moment (N, 3), N m, of the weight about points (N, 3)."""
        return np.cross(1e-3 * (self.place_mm - about_mm), self.weight_n)


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm at N poses: its table, the commanded joints, and the displacement of each part from the commanded state.

    In the order of the chain: the base turns; each joint's axis tilts at its own origin; the joint turns to `q`; all
    lengths grow; the end of each link turns and shifts in its own frame; the target shifts in the base frame.
    Turns are rotation vectors and made as exact rotations.
    """

    robot: Robot
    conditions: Conditions
    commanded: Array  # (N, n) rad, mm for prismatic joints
    q: Array  # (N, n) true joint values
    base_turn_rad: Array  # (N, 3)
    axis_tilt_rad: Array  # (N, n, 3) in the frame before the joint
    growth: Array  # (N,) factor of every a and d
    link_turn_rad: Array  # (N, n, 3) in the frame after the link
    link_shift_mm: Array  # (N, n, 3)
    target_shift_mm: Array  # (N, 3)

    @classmethod
    def commanded_to(cls, robot: Robot, q: ArrayLike, conditions: Conditions = STANDARD) -> Arm:
        """The arm without any effect at the commanded joints q (N, n)."""
        q = np.asarray(q, dtype=float)
        each, parts = np.zeros((len(q), 3)), np.zeros((*q.shape, 3))
        return cls(robot, conditions, q, q, each, parts, np.ones(len(q)), parts, parts, each)

    @cached_property
    def base_T_axis(self) -> tuple[Array, ...]:
        """Frames, n times (N, 4, 4), whose z axis is the axis of joint j and whose origin is the joint's own."""
        return self._chain[0]

    @cached_property
    def base_T_frame(self) -> tuple[Array, ...]:
        """Frames, n + 2 times (N, 4, 4): base, frames 1..n, tool."""
        return self._chain[1]

    @cached_property
    def base_T_straight(self) -> tuple[Array, ...]:
        """Frames, n times (N, 4, 4), at the end of each link before bending."""
        return self._chain[2]

    @cached_property
    def _chain(self) -> tuple[tuple[Array, ...], tuple[Array, ...], tuple[Array, ...]]:
        """Frames of `base_T_axis`, `base_T_frame` and `base_T_straight`."""
        robot, count = self.robot, len(self.q)
        axes, straight = [], []
        first = np.eye(4)
        first[:3, :3] = Rotation.from_euler("xyz", robot.base.rpy_rad).as_matrix()
        first[:3, 3] = robot.base.xyz_mm
        turned = moved_by(np.broadcast_to(np.eye(4), (count, 4, 4)), self.base_turn_rad)
        frame = [turned @ first]
        for j, row in enumerate((*robot.joints, robot.tool)):
            here = frame[-1]
            turn_rad, slide_mm = np.full(count, row.theta_rad), row.d_mm * self.growth
            if j < robot.n_joints:
                here = moved_by(here, self.axis_tilt_rad[:, j])
                axes.append(here)
                if robot.joints[j].is_revolute:
                    turn_rad += self.q[:, j]
                else:
                    slide_mm += self.q[:, j]
            here = here @ _turn("z", turn_rad) @ _shift("x", row.a_mm * self.growth) @ _shift("z", slide_mm)
            here = here @ _turn("x", np.array([row.alpha_rad])) @ _turn("y", np.array([row.beta_rad]))
            if j < robot.n_joints:
                straight.append(here)
                here = moved_by(here, self.link_turn_rad[:, j], self.link_shift_mm[:, j])
            elif np.any(self.target_shift_mm):
                here = here.copy()
                here[:, :3, 3] += self.target_shift_mm
            frame.append(here)
        return tuple(axes), tuple(frame), tuple(straight)

    @cached_property
    def weights(self) -> tuple[Weight, ...]:
        """Weights of links, tool and payload. Raises CalibError where a joint has no mass."""
        robot = self.robot
        without = [joint.name or f"J{j + 1}" for j, joint in enumerate(robot.joints) if joint.mass_kg is None]
        if without:
            raise CalibError(
                f"robot {robot.name}: no mass_kg for {', '.join(without)}; gravity torques need every link's mass"
            )
        gravity = np.array(robot.gravity_m_s2)
        n, count = robot.n_joints, len(self.q)
        weights = [
            Weight(j, self.place_mm(j, joint.com_mm), np.full((count, 1), joint.mass_kg) * gravity)
            for j, joint in enumerate(robot.joints)
        ]
        tool, load_kg = robot.tool, self.conditions.payload_kg
        if tool.mass_kg is not None:
            weights.append(Weight(n, self.place_mm(n - 1, tool.com_mm), np.full((count, 1), tool.mass_kg) * gravity))
        if load_kg is not None:
            held = tool.payload_com_mm
            place_mm = self.base_T_frame[-1][:, :3, 3] if held is None else self.place_mm(n - 1, held)
            weights.append(Weight(n, place_mm, np.asarray(load_kg, dtype=float)[:, None] * gravity))
        return tuple(weights)

    def place_mm(self, joint: int, point_mm: ArrayLike | None) -> Array:
        """Base-frame position (N, 3) of a point in the frame after `joint`; of its origin where `point_mm` is None."""
        homogeneous = np.array([*np.asarray((0.0, 0.0, 0.0) if point_mm is None else point_mm, float), 1.0])
        return (self.base_T_frame[joint + 1] @ homogeneous)[:, :3]

    def moment_nm(self, about_mm: Array, first: int) -> Array:
        """Moment (N, 3), N m, about points (N, 3) of all weights whose carrier is `first` or beyond."""
        beyond = [weight.moment_nm(about_mm) for weight in self.weights if weight.carrier >= first]
        return np.sum(beyond, axis=0) if beyond else np.zeros((len(self.q), 3))

    @cached_property
    def gravity_torques(self) -> Array:
        """Gravity's torques (N, n): tau_j = z_j . sum_k (c_k - o_j) x m_k g over every mass k beyond joint j.

        Nm, or N of force along the axis for a prismatic joint. Positive drives the joint onwards.
        """
        torque = np.zeros_like(self.q)
        for j, joint in enumerate(self.robot.joints):
            axis, origin_mm = self.base_T_axis[j][:, :3, 2], self.base_T_axis[j][:, :3, 3]
            if joint.is_revolute:
                push = self.moment_nm(origin_mm, j)
            else:
                push = np.sum([weight.weight_n for weight in self.weights if weight.carrier >= j], axis=0)
            torque[:, j] = np.sum(axis * push, axis=1)
        return torque


def moved_by(a_T_b: Array, turn_rad: Array, shift_mm: Array | None = None) -> Array:
    """Frames a_T_b (N, 4, 4) with b shifted (N, 3) and turned by rotation vectors (N, 3), both in b."""
    if not np.any(turn_rad) and (shift_mm is None or not np.any(shift_mm)):
        return a_T_b
    step = np.tile(np.eye(4), (len(turn_rad), 1, 1))
    step[:, :3, :3] = Rotation.from_rotvec(turn_rad).as_matrix()
    if shift_mm is not None:
        step[:, :3, 3] = shift_mm
    return a_T_b @ step


def in_frame(base_T_frame: Array, vector: Array) -> Array:
    """Vectors (N, 3) of the base in the axes of a frame (N, 4, 4)."""
    return np.einsum("nji,nj->ni", base_T_frame[:, :3, :3], vector)


def _turn(axis: str, angle_rad: Array) -> Array:
    """Rotations (N, 4, 4) about an axis by angles (N,) rad."""
    k = "xyz".index(axis)
    i, j = (k + 1) % 3, (k + 2) % 3
    out = np.tile(np.eye(4), (len(angle_rad), 1, 1))
    out[:, i, i] = out[:, j, j] = np.cos(angle_rad)
    out[:, j, i] = np.sin(angle_rad)
    out[:, i, j] = -out[:, j, i]
    return out


def _shift(axis: str, length_mm: Array) -> Array:
    """Shifts (N, 4, 4) along an axis by lengths (N,) mm."""
    out = np.tile(np.eye(4), (len(length_mm), 1, 1))
    out[:, "xyz".index(axis), 3] = length_mm
    return out


@dataclass(frozen=True, eq=False)
class TrueEffect:
    """A physical effect on the arm, or on the points that the scanner reports; no change at magnitude zero.

    `magnitude_fields` names the fields that are proportional to the effect; all others describe where or how it acts.
    """

    name: ClassVar[str]
    magnitude_fields: ClassVar[tuple[str, ...]]
    needs_equilibrium: ClassVar[bool] = False  # on the arm under load, not on the command alone

    def change_arm(self, arm: Arm, equilibrium: Arm) -> Arm:
        """The arm with this effect, by the torques and positions of `equilibrium`, the arm under all effects."""
        return arm

    def change_measurement(self, scanner_T_target: Array, conditions: Conditions, sign: float) -> Array:
        """Tool frame (N, 4, 4) as reported under this effect; the jig's apex points along `sign` times its z axis."""
        return scanner_T_target

    def scaled(self, factor: float) -> TrueEffect:
        """Effect that is `factor` times as large."""
        return replace(self, **{name: factor * getattr(self, name) for name in self.magnitude_fields})

    @property
    def is_absent(self) -> bool:
        """Whether the effect's magnitude is zero."""
        return not any(np.any(getattr(self, name)) for name in self.magnitude_fields)

    def parameters(self) -> dict[str, Any]:
        """All fields as plain numbers, for truth.json."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: np.asarray(value).tolist() for name, value in values.items()}


def needed(value: Array | None, column: str, effect: TrueEffect) -> Array:
    """Values of a condition that an effect requires. Raises CalibError where they are missing."""
    if value is None:
        raise CalibError(f"{effect.name} needs {column} at every pose; simulate with conditions")
    return value
