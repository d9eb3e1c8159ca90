"""What a simulated arm really does, worked out apart from everything that fits it.

The chain is a product of elementary turns and shifts, written out one by one; gravity's torque comes from each mass
and its lever, and a joint that yields is followed to its equilibrium. None of it is shared with `calib.kinematics` or
the effects that a fit uses, so that agreement between the two means something.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from calib.errors import CalibError
from calib.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """A simulated cell: the arm with its errors, and where the scanner stands.

    Joint j turns by `q_j + sum_n (cos_n cos(n q_j) + sin_n sin(n q_j)) + c_j tau_j`: transmission error at the
    commanded angle, and compliance c_j under the gravity torque tau_j at the pose that results.
    """

    robot: Robot  # the true link table; masses are those of the nominal arm
    base_T_scanner: Array  # (4, 4)
    joint_compliance_rad_per_nm: Array  # (n,)
    transmission_cos_rad: Array  # (n, H), column h - 1 is harmonic h
    transmission_sin_rad: Array  # (n, H)

    @classmethod
    def without_effects(cls, robot: Robot, base_T_scanner: ArrayLike) -> Truth:
        n = robot.n_joints
        return cls(
            robot, np.asarray(base_T_scanner, dtype=float), np.zeros(n), np.zeros((n, 2)), np.zeros((n, 2))
        )

    def effects(self) -> tuple[str, ...]:
        """The families (EFFECTS.md's names) that this arm carries."""
        present = {
            "joint_compliance": self.joint_compliance_rad_per_nm,
            "transmission_error": np.hypot(self.transmission_cos_rad, self.transmission_sin_rad),
        }
        return tuple(name for name, size in present.items() if np.any(size != 0.0))


def frames(robot: Robot, q: ArrayLike) -> list[Array]:
    """base_T_frame (N, 4, 4) of base, frames 1..n and the tool: Rz(theta + q) Tx(a) Tz(d) Rx(alpha) Ry(beta) a row."""
    q = np.asarray(q, dtype=float)
    base_T_frame = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
    for j, row in enumerate((*robot.joints, robot.tool)):
        turn_rad, slide_mm = np.full(len(q), row.theta_rad), np.full(len(q), row.d_mm)
        if j < robot.n_joints:
            if robot.joints[j].is_revolute:
                turn_rad += q[:, j]
            else:
                slide_mm += q[:, j]
        step = (
            _turn("z", turn_rad)
            @ _shift("x", np.array([row.a_mm]))
            @ _shift("z", slide_mm)
            @ _turn("x", np.array([row.alpha_rad]))
            @ _turn("y", np.array([row.beta_rad]))
        )
        base_T_frame.append(base_T_frame[-1] @ step)
    return base_T_frame


def gravity_torques(robot: Robot, q: ArrayLike, payload_kg: ArrayLike | None = None) -> Array:
    """tau_j = z_j . sum_k (c_k - o_j) x m_k g over every mass k beyond joint j, at joint vectors q as they are.

    Returns (N, n): Nm, or N of force along the axis for a prismatic joint. Positive drives the joint onwards.

    Raises:
        CalibError: a joint has no mass.
    """
    q = np.asarray(q, dtype=float)
    without = [joint.name or f"J{j + 1}" for j, joint in enumerate(robot.joints) if joint.mass_kg is None]
    if without:
        raise CalibError(
            f"robot {robot.name}: no mass_kg for {', '.join(without)}; gravity torques need every link's mass"
        )
    base_T_frame = frames(robot, q)
    gravity = np.array(robot.gravity_m_s2)

    weights: list[
        tuple[int, Array, Array]
    ] = []  # the frame that carries it, its place (N, 3) mm, its weight (N, 3) N
    for j, joint in enumerate(robot.joints):
        place_mm = _place(base_T_frame[j + 1], joint.com_mm)
        weights.append((j, place_mm, np.full((len(q), 1), joint.mass_kg) * gravity))
    last = robot.n_joints - 1
    flange = base_T_frame[-2]
    if robot.tool.mass_kg:
        weights.append(
            (last, _place(flange, robot.tool.com_mm), np.full((len(q), 1), robot.tool.mass_kg) * gravity)
        )
    if payload_kg is not None:
        load_kg = np.broadcast_to(np.asarray(payload_kg, dtype=float), (len(q),))[:, None]
        weights.append((last, _place(flange, robot.tool.payload_com_mm), load_kg * gravity))

    torque = np.zeros_like(q)
    for j, joint in enumerate(robot.joints):
        axis, origin_mm = base_T_frame[j][:, :3, 2], base_T_frame[j][:, :3, 3]
        for carrier, place_mm, weight_n in weights:
            if carrier >= j:
                push = np.cross(1e-3 * (place_mm - origin_mm), weight_n) if joint.is_revolute else weight_n
                torque[:, j] += np.sum(axis * push, axis=1)
    return torque


def settle(truth: Truth, q: ArrayLike, payload_kg: ArrayLike | None = None) -> Array:
    """Where the joints really stand (N, n) when q is commanded: q + transmission(q) + c tau(result).

    The arm sags until torque and deflection agree, so the torque is taken at the result, by repetition to rounding.

    Raises:
        CalibError: the joints are so soft that the arm has no equilibrium nearby.
    """
    q = np.asarray(q, dtype=float)
    harmonics = np.arange(1, truth.transmission_cos_rad.shape[1] + 1)
    phase = q[:, :, None] * harmonics  # (N, n, H)
    geared = q + np.sum(
        truth.transmission_cos_rad * np.cos(phase) + truth.transmission_sin_rad * np.sin(phase), axis=2
    )
    if not np.any(truth.joint_compliance_rad_per_nm):
        return geared
    settled = geared
    for _ in range(200):
        sagged = geared + truth.joint_compliance_rad_per_nm * gravity_torques(
            truth.robot, settled, payload_kg
        )
        step_rad = float(np.max(np.abs(sagged - settled)))
        settled = sagged
        if step_rad < 1e-14:
            return settled
    worst = float(np.max(truth.joint_compliance_rad_per_nm))
    raise CalibError(
        f"robot {truth.robot.name}: joints of up to {worst:g} rad/Nm find no equilibrium under gravity "
        f"(still moving by {step_rad:.1e} rad); real joints have 1e-6 ... 1e-3 rad/Nm"
    )


def base_T_target(truth: Truth, q: ArrayLike, payload_kg: ArrayLike | None = None) -> Array:
    """(N, 4, 4) the true tool frame when q (N, n) is commanded."""
    return frames(truth.robot, settle(truth, q, payload_kg))[-1]


def scanner_T_target(truth: Truth, q: ArrayLike, payload_kg: ArrayLike | None = None) -> Array:
    """(N, 4, 4) the true tool frame as the scanner has it."""
    return np.linalg.inv(truth.base_T_scanner) @ base_T_target(truth, q, payload_kg)


def truth_document(truth: Truth, nominal: Robot, **more: Any) -> dict[str, Any]:
    """What truth.json holds; angles in degrees as in every file of a dataset, effects in their own units."""
    table, error = truth.robot.table, truth.robot.table - nominal.table
    rows = [*(f"J{j + 1}" for j in range(nominal.n_joints)), "TCP"]

    def links(values: Array) -> dict[str, Mapping[str, float]]:
        keys = ("a_mm", "alpha_deg", "d_mm", "theta_deg", "beta_deg")
        scale = np.array([1.0, np.degrees(1.0), 1.0, np.degrees(1.0), np.degrees(1.0)])
        return {
            name: dict(zip(keys, (row * scale).tolist(), strict=True))
            for name, row in zip(rows, values, strict=True)
        }

    effects: dict[str, Any] = {}
    if "joint_compliance" in truth.effects():
        effects["joint_compliance"] = {"c_rad_per_nm": truth.joint_compliance_rad_per_nm.tolist()}
    if "transmission_error" in truth.effects():
        effects["transmission_error"] = {
            f"harmonic_{h + 1}": {
                "cos_rad": truth.transmission_cos_rad[:, h].tolist(),
                "sin_rad": truth.transmission_sin_rad[:, h].tolist(),
            }
            for h in range(truth.transmission_cos_rad.shape[1])
        }
    return {
        "format": 1,
        "robot": nominal.name,
        "effects": effects,
        "links": links(table),
        "link_errors": links(error),
        "base_T_scanner_mm": truth.base_T_scanner.tolist(),
        **more,
    }


def _turn(axis: str, angle_rad: Array) -> Array:
    """(N, 4, 4)"""
    out = np.tile(np.eye(4), (len(angle_rad), 1, 1))
    out[:, :3, :3] = Rotation.from_euler(axis, angle_rad[:, None]).as_matrix()
    return out


def _shift(axis: str, length_mm: Array) -> Array:
    """(N, 4, 4)"""
    out = np.tile(np.eye(4), (len(length_mm), 1, 1))
    out[:, "xyz".index(axis), 3] = length_mm
    return out


def _place(base_T_frame: Array, point_mm: tuple[float, float, float] | None) -> Array:
    """A point of a moving frame in the base's (N, 3); the frame's origin where none is given."""
    homogeneous = np.array([*(point_mm or (0.0, 0.0, 0.0)), 1.0])
    return (base_T_frame @ homogeneous)[:, :3]
