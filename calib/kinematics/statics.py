"""Statics of an arm as a linear law: the torque of weight about a joint by masses and first moments of its links.

Link k weighs m_k and has the first moment m_k c_k about its frame's origin. About joint j, with axis z_j through o_j,

    tau_j = sum over k >= j of  m_k z_j . ((o_k - o_j) x g)  +  (m_k c_k) . R_k^T (g x z_j)

which is linear in the unknown masses and moments. So measured torques tell the load of a joint without a table of
masses, though not each mass: some shift of mass from link to link changes no torque.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.kinematics.chain import Chain
from calib.kinematics.robot import MeasuredLoad, Robot

PER_LINK = 4  # columns: the mass at the frame's origin, and the first moment along its x, y and z


def statics_columns(robot: Robot, chain: Chain, joint: int, payload_kg: Array | None) -> Array:
    """Torque about a revolute joint, N m, by 1 kg at the origin of each later frame and by 1 kg m along its axes.

    Shape (N, 4 K) for the K links from the joint's own on, and 4 columns more for a payload (N,) kg in the last frame:
    the torque by the payload at that frame's origin, and by each metre of its centre along the axes.
    """
    gravity = np.array(robot.gravity_m_s2)
    frames = chain.base_T_frame[:, joint + 1 : robot.n_joints + 1]  # (N, K, 4, 4)
    axis, origin_mm = chain.base_T_frame[:, joint, :3, 2], chain.base_T_frame[:, joint, :3, 3]
    by_force = np.cross(gravity, axis)  # z . (r x g) = r . (g x z)
    by_mass = np.einsum("nki,ni->nk", 1e-3 * (frames[..., :3, 3] - origin_mm[:, None]), by_force)
    by_moment = np.einsum("nkia,ni->nka", frames[..., :3, :3], by_force)
    columns = np.concatenate([by_mass[..., None], by_moment], axis=2)  # (N, K, 4)
    of_links = columns.reshape(len(columns), -1)
    payload_kg = np.zeros(len(columns)) if payload_kg is None else payload_kg
    return np.concatenate([of_links, payload_kg[:, None] * columns[:, -1]], axis=1)


def masses_and_moments(robot: Robot, joint: int) -> Array:
    """Masses, kg, and first moments, kg m, of the links from a joint's own on (`statics_columns`), by robot.toml.

    The tool's mass is part of the last link. The last four are 1 and the centre of a payload, m.
    """
    rows = np.zeros((robot.n_joints - joint + 1, PER_LINK))
    tool = robot.tool
    hanging = [(k - joint, part.mass_kg, part.com_mm) for k, part in enumerate(robot.joints) if k >= joint]
    for row, mass_kg, com_mm in [*hanging, (robot.n_joints - 1 - joint, tool.mass_kg, tool.com_mm)]:
        mass = mass_kg or 0.0
        rows[row] += mass * np.array([1.0, *(1e-3 * np.array(com_mm or (0.0, 0.0, 0.0)))])
    turned = np.array([tool.a_mm * np.cos(tool.theta_rad), tool.a_mm * np.sin(tool.theta_rad), tool.d_mm])
    rows[-1] = [1.0, *(1e-3 * (turned if tool.payload_com_mm is None else np.array(tool.payload_com_mm)))]
    return rows.reshape(-1)


@dataclass(frozen=True)
class TorqueReading(Brief):
    """Measured torques of a joint at the poses of a state, with the sides that the joint came from, where known."""

    torque_nm: Array  # (N,) as written down
    approach: Array | None  # (N,) of -1, 1


def uncertain_loads(robot: Robot) -> Iterator[Robot]:
    """Variants of a robot, in each of which the load of one joint is off by one standard deviation in one way."""
    for k, load in enumerate(robot.measured_loads):
        for change in load.spread:
            weights = tuple(weight + more for weight, more in zip(load.weights, change, strict=True))
            loads = (*robot.measured_loads[:k], replace(load, weights=weights), *robot.measured_loads[k + 1 :])
            yield replace(robot, measured_loads=loads)


def load_torque(
    robot: Robot, chain: Chain, load: MeasuredLoad, payload_kg: Array | None, reading: TorqueReading | None
) -> Array:
    """Torque (N,), N m, that weight and whatever else pulls at the arm exert about a joint whose torque is measured.

    Without a reading, as at targets to be reached, it is that of the weight that the measured torques speak for.
    """
    by_weight = statics_columns(robot, chain, load.joint, payload_kg) @ np.array(load.weights)
    if reading is None or load.trust == 0.0:
        return np.asarray(by_weight)
    beside = load.offset_nm + (0.0 if reading.approach is None else load.friction_nm * reading.approach)
    return by_weight + load.trust * (load.sign * reading.torque_nm - beside - by_weight)
