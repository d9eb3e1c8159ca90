"""What lies between a joint's motor and its link, by an encoder on the link's side: a sum of laws of known form.

The link stands at q + offset + sum of terms. The laws are those of the catalogue's effects on one joint; each is linear
in its values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.robot import DriveTerm, LinkEncoder, Robot
from calib.kinematics.statics import TorqueReading, load_torque, masses_and_moments, statics_columns

HARMONICS = (1, 2, 3)  # a turn


@dataclass(frozen=True)
class DriveInputs(Brief):
    """What the laws between motor and link depend on, at N poses."""

    q: Array  # (N, n) of the motors, rad
    payload_kg: Array | None = None  # (N,)
    approach: Array | None = None  # (N, n) of -1, 1
    torque_nm: Array | None = None  # (N,) measured torque of the joint


def knows_load(robot: Robot, joint: int) -> bool:
    """Whether the load of a joint is known, by measured torques or by the masses of robot.toml."""
    masses = all(part.mass_kg is not None and part.com_mm is not None for part in robot.joints)
    return masses or robot.measured_load(joint) is not None


def load_of_joint(robot: Robot, chain: Chain, joint: int, inputs: DriveInputs) -> Array:
    """Torque (N,), N m, that pulls at a joint."""
    load = robot.measured_load(joint)
    if load is None:
        columns = statics_columns(robot, chain, joint, inputs.payload_kg)
        return columns @ masses_and_moments(robot, joint)
    side = None if inputs.approach is None else inputs.approach[:, joint]
    reading = None if inputs.torque_nm is None else TorqueReading(inputs.torque_nm, side)
    return load_torque(robot, chain, load, inputs.payload_kg, reading)


def term_columns(robot: Robot, chain: Chain, joint: int, law: str, inputs: DriveInputs) -> Array:
    """Turn of the link (N, K) by one unit of each value of a law.

    law: "joint_compliance", "unknown_masses" (compliance times masses and moments), "gravity_backlash", "backlash",
    "joint_scale", or "harmonic 2", so many waves a turn.
    """
    q = inputs.q[:, joint]
    if law == "joint_compliance":
        return load_of_joint(robot, chain, joint, inputs)[:, None]
    if law == "unknown_masses":
        return statics_columns(robot, chain, joint, inputs.payload_kg)
    if law == "gravity_backlash":
        return 0.5 * np.sign(load_of_joint(robot, chain, joint, inputs))[:, None]
    if law == "backlash":
        side = np.zeros(len(q)) if inputs.approach is None else inputs.approach[:, joint]
        return 0.5 * side[:, None]
    if law == "joint_scale":
        return q[:, None]
    waves = float(law.removeprefix("harmonic "))
    return np.column_stack([np.sin(waves * q), np.cos(waves * q)])


def turn_by_law(robot: Robot, encoder: LinkEncoder, inputs: DriveInputs) -> Array:
    """Turn (N,), rad, of a link against its motor where its encoder was not read, less the constant offset."""
    if not encoder.terms:
        return np.zeros(len(inputs.q))
    chain = nominal_chain(robot, inputs.q)
    return np.asarray(sum(term_turn(robot, chain, encoder.joint, term, inputs) for term in encoder.terms))


def term_turn(robot: Robot, chain: Chain, joint: int, term: DriveTerm, inputs: DriveInputs) -> Array:
    """Turn (N,), rad, of a link by one law."""
    return np.asarray(term_columns(robot, chain, joint, term.law, inputs) @ np.array(term.values)) - term.mean_rad


def turn_by_encoder(link_rad: Array, q: Array, encoder: LinkEncoder) -> Array:
    """Turn (N,), rad, of a link against its motor as its encoder reads it, less the constant offset."""
    return (link_rad - q - encoder.offset_rad + np.pi) % (2.0 * np.pi) - np.pi
