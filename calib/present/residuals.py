"""Inputs and residuals of the tab "Where it fails": titles with units, values to plot, noise band."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.calibration.pose_errors import PoseErrors
from calib.dataset.input_names import PLACES, joint_input
from calib.kinematics.robot import Robot
from calib.present import numbers

LENGTH = "error length"
AXES = {f"error in {axis} of the scanner": k for k, axis in enumerate("xyz")}
UNITS = {"payload_kg": "kg", "temperature_c": "°C", "time_s": "s", "x": "mm", "y": "mm", "z": "mm"}
NAMES = {
    "payload_kg": "payload",
    "temperature_c": "temperature",
    "time_s": "time",
    "order": "order of measuring",
}


def band_note(pose_errors: PoseErrors, band: tuple[float, float]) -> str:
    """Sentences on the grey noise band of a plot, with the number of poses outside it where that can be counted."""
    noise = pose_errors.noise.words(numbers.length(pose_errors.noise_mm), " a coordinate")
    grey = f"Grey: where {noise} leaves 19 of 20 poses."
    if not np.isfinite(band).all():
        return "These poses do not tell how much noise alone would make of it: there is no band."
    outside = pose_errors.error_length_mm > pose_errors.length_noise_mm
    counts = [
        f"{np.count_nonzero(outside & of)} of {numbers.count(int(np.count_nonzero(of)), name)}"
        for of, name in ((~pose_errors.is_test, "training pose"), (pose_errors.is_test, "test pose"))
        if of.any()
    ]
    return f"{grey} By their length, {numbers.listing(counts)} are off by more."


def input_title(name: str, robot: Robot) -> str:
    """Title of an input with its unit: "q3" -> "joint 3 angle, °"."""
    of_joint = joint_input(name)
    if of_joint is not None:
        quantity, joint = of_joint
        angle = "angle, °" if robot.joints[joint].is_revolute else "position, mm"
        what = {"q": angle, "torque": "gravity torque, Nm", "approach": "approach (−1 or 1)"}[quantity]
        return f"joint {joint + 1} {what}"
    if name in PLACES:
        return f"place {name} in the scanner's frame, mm"
    return NAMES.get(name, name) + (f", {UNITS[name]}" if name in UNITS else "")


def turned(name: str, values: Array, robot: Robot) -> Array:
    """Values with joint angles converted to degrees and all others unchanged."""
    quantity, joint = joint_input(name) or ("", 0)
    angle = quantity == "q" and robot.joints[joint].is_revolute
    return np.degrees(values) if angle else values


def joint_title(joint: int, robot: Robot) -> str:
    """Axis title of a joint's apparent motion, with its unit."""
    return f"apparent motion of joint {joint + 1}, {'millidegrees' if robot.joints[joint].is_revolute else 'mm'}"


def shown(
    pose_errors: PoseErrors, what: str, joint: int | None, robot: Robot
) -> tuple[Array, str, tuple[float, float]]:
    """Values to plot, their title with the unit, and the band of noise alone."""
    if joint is not None:
        scale = float(np.degrees(1.0)) * 1000.0 if robot.joints[joint].is_revolute else 1.0
        half = 2.0 * scale * pose_errors.joint_noise(joint)
        return scale * pose_errors.apparent_joint_error[:, joint], what, (-half, half)
    if what in AXES:
        half = 2.0 * pose_errors.noise_mm
        return pose_errors.error_mm[:, AXES[what]], f"{what}, mm", (-half, half)
    return pose_errors.error_length_mm, f"{LENGTH}, mm", (0.0, pose_errors.length_noise_mm)
