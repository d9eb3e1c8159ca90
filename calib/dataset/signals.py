"""Signals of an arm beside its commanded joints, as further columns of poses.csv.

torque2_nm is the measured torque of joint 2, link_q2_deg its angle by an encoder on the link's side,
temperature_motor2_c a temperature called "motor2", and load_left_q3_deg joint 3 of a further body "left" that stands on
the same base. They stay among the further columns (`Poses.extra`), under their names.
"""

from __future__ import annotations

import re

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.dataset.further_columns import is_number
from calib.kinematics.drive import DriveInputs
from calib.kinematics.robot import Robot

_NUMBER = "[1-9][0-9]{0,2}"
_TORQUE = re.compile(rf"torque({_NUMBER})_nm")
_LINK = re.compile(rf"link_q({_NUMBER})_deg")
_TEMPERATURE = re.compile(r"temperature_(\w+)_c")
_OTHER_BODY = re.compile(rf"load_(\w+)_q({_NUMBER})_deg")
_LIMITS = ((_TORQUE, 1e6), (_LINK, 1e5), (_TEMPERATURE, 5e3), (_OTHER_BODY, 1e5))


def limit_of(column: str) -> float | None:
    """Largest size of a signal's value, in the unit that its column names; None for any other column."""
    return next((limit for pattern, limit in _LIMITS if pattern.fullmatch(column)), None)


def is_signal(column: str) -> bool:
    """Whether a column of poses.csv is a signal."""
    return limit_of(column) is not None


def measured_torque_nm(poses: Poses, joint: int) -> Array | None:
    """Measured torque (N,) of a joint (counted from 0), as written down; None where it was not measured."""
    return _numbers(poses, f"torque{joint + 1}_nm")


def link_angle_rad(poses: Poses, joint: int) -> Array | None:
    """Angle (N,), rad, of a joint (counted from 0) by an encoder on the link's side; None where it was not read."""
    angle_deg = _numbers(poses, f"link_q{joint + 1}_deg")
    return None if angle_deg is None else np.radians(angle_deg)


def drive_inputs(poses: Poses, joint: int) -> DriveInputs:
    """What the laws between a joint's motor and its link depend on, at some poses."""
    return DriveInputs(poses.q, poses.payload_kg, poses.approach, measured_torque_nm(poses, joint))


def has_stand_in(robot: Robot, column: str) -> bool:
    """Whether a model of a robot predicts without a column too: the readings of torques and of link encoders."""
    loads = (f"torque{load.joint + 1}_nm" for load in robot.measured_loads)
    return column in (*loads, *(f"link_q{encoder.joint + 1}_deg" for encoder in robot.link_encoders))


def named_temperatures(poses: Poses) -> dict[str, Array]:
    """Temperatures (N,), C, by the name of their sensor: "motor2" for temperature_motor2_c."""
    found = {}
    for column in poses.extra.names:
        match, values = _TEMPERATURE.fullmatch(column), _numbers(poses, column)
        if match is not None and values is not None:
            found[match[1]] = values
    return found


def joints_of_other_bodies(poses: Poses) -> dict[str, Array]:
    """Joint angles (N,), degrees, of further bodies, by the name of their column: "load_left_q3_deg"."""
    found = ((column, _numbers(poses, column)) for column in poses.extra.names if _OTHER_BODY.fullmatch(column))
    return {column: values for column, values in found if values is not None}


def _numbers(poses: Poses, column: str) -> Array | None:
    values = poses.extra.by_name.get(column)
    return None if values is None or not is_number(values) else np.asarray(values, dtype=float)
