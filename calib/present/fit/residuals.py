"""Residual of a fit plotted over the inputs it may depend on: titles with units, values, noise band and tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.calibration.model_versions import model_name
from calib.calibration.noise_level import NoiseLevel
from calib.calibration.pose_errors import PoseErrors, pose_errors_of
from calib.calibration.result import Calibration
from calib.dataset.input_names import joint_input
from calib.diagnosis.result import Diagnosis
from calib.kinematics.robot import Robot
from calib.present import names
from calib.present.names import input_title
from calib.rendering import numbers
from calib.rendering.blocks import Block, FigurePlace, Paragraph, Table, joint, pose
from calib.screening.residual_tests import STRUCTURE_LEVEL, InputTest, ResidualTests, run_residual_tests

LENGTH = "error length"
AXES = {f"error in {axis} of the instrument": k for k, axis in enumerate("xyz")}


_LISTED_INPUTS = 5  # the strongest
_DRAWN_INPUTS = 2


def noise_and_size(noise: NoiseLevel, length_mm: float) -> str:
    """Name of the noise with its sigma in brackets: "noise alone (0.05 mm per coordinate)"."""
    undeclared = "" if noise.is_declared else ": not declared"
    return f"{noise.name} ({numbers.length(length_mm)} per coordinate{undeclared})"


def band_note(pose_errors: PoseErrors, band: tuple[float, float]) -> str:
    """Sentences on the grey noise band of a plot, with the number of poses outside it where that can be counted."""
    noise = noise_and_size(pose_errors.noise, pose_errors.noise_mm)
    grey = f"Grey: where {noise} leaves 19 of 20 poses."
    if not np.isfinite(band).all():
        return "These poses do not determine how much of it noise alone would make: there is no band."
    outside = pose_errors.error_length_mm > pose_errors.length_noise_mm
    counts = [
        f"{np.count_nonzero(outside & of)} of {numbers.count(int(np.count_nonzero(of)), name)}"
        for of, name in ((~pose_errors.is_test, "training pose"), (pose_errors.is_test, "test pose"))
        if of.any()
    ]
    return f"{grey} By their length, {numbers.listing(counts)} are off by more."


def turned(name: str, values: Array, robot: Robot) -> Array:
    """Input values for a plot: joint angles converted to degrees, all others unchanged."""
    quantity, joint = joint_input(name) or ("", 0)
    angle = quantity == "q" and robot.joints[joint].is_revolute
    return np.degrees(values) if angle else values


def joint_title(joint: int, robot: Robot) -> str:
    """Axis title of a joint's apparent motion, with its unit."""
    return f"apparent motion of joint {joint + 1}, {'millidegrees' if robot.joints[joint].is_revolute else 'mm'}"


def shown(
    pose_errors: PoseErrors, what: str, joint: int | None, robot: Robot
) -> tuple[Array, str, tuple[float, float]]:
    """Residual values to plot, their title with the unit, and the band of noise alone."""
    if joint is not None:
        scale = float(np.degrees(1.0)) * 1000.0 if robot.joints[joint].is_revolute else 1.0
        half = 2.0 * scale * pose_errors.joint_noise(joint)
        return scale * pose_errors.apparent_joint_error[:, joint], what, (-half, half)
    if what in AXES:
        half = 2.0 * pose_errors.noise_mm
        return pose_errors.error_mm[:, AXES[what]], f"{what}, mm", (-half, half)
    return pose_errors.error_length_mm, f"{LENGTH}, mm", (0.0, pose_errors.length_noise_mm)


def worst_poses(pose_errors: PoseErrors, count: int, marked: str = "") -> Table:
    """Table of the poses with the largest errors, mm in the scanner's frame; the row of one pose is marked."""
    worst = pose_errors.worst(count)
    rows = []
    for name in worst:
        k = pose_errors.pose_ids.index(name)
        role = names.role("test" if pose_errors.is_test[k] else "train")
        error = (numbers.signed(float(e), "+.4f") for e in pose_errors.error_mm[k])
        rows.append((name, role, numbers.column_mm(float(pose_errors.error_length_mm[k])), *error))
    return Table(
        ("pose", "role", "length", "x", "y", "z"),
        rows,
        left=(0, 1),
        mark=worst.index(marked) if marked in worst else None,
        rows_select=[pose(name) for name in worst],
    )


# ---- tests of the residual ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ModelResidual:
    """Residual of one model's fit: the errors of the poses, and their tests over every input."""

    calibration: Calibration
    pose_errors: PoseErrors
    residual_tests: ResidualTests


def residuals_of(diagnosis: Diagnosis) -> list[ModelResidual]:
    """Residuals of a diagnosis' fits: the first fit if effects were added, then the last fit."""
    first, last = diagnosis.steps[0], diagnosis.calibration
    found = [ModelResidual(last, pose_errors_of(last), diagnosis.residual_tests)]
    if len(diagnosis.steps) > 1 and first.screening is not None:
        tests = run_residual_tests(first.calibration.dataset, first.screening.projected)
        found.insert(0, ModelResidual(first.calibration, pose_errors_of(first.calibration), tests))
    return found


def residual_blocks(residuals: Sequence[ModelResidual]) -> list[Block]:
    """Blocks on the inputs that each model's residual depends on most, with figures of the residual over these."""
    return [block for residual in residuals for block in _residual_blocks(residual)]


def _residual_blocks(residual: ModelResidual) -> list[Block]:
    model, robot = model_name(residual.calibration.model), residual.calibration.dataset.robot
    inputs = [test for test in residual.residual_tests.inputs if test.input in residual.pose_errors.inputs]
    if not inputs:
        return [Paragraph(f"{model}: no input varies that the residual could follow.")]
    listed = inputs[:_LISTED_INPUTS]
    of_joints = [joint_input(test.input) for test in listed]
    table = Table(
        ("input", "shows most in", "p"),
        [(input_title(t.input, robot), _channel_title(t, robot), numbers.probability(t.p_value)) for t in listed],
        left=(0, 1),
        caption=f"Model: {model}. Dependence on the inputs, the strongest first; p is corrected for all looked at",
        rows_select=[None if one is None else joint(one[1] + 1) for one in of_joints],
    )
    structured = [test for test in inputs if test.p_value < STRUCTURE_LEVEL] or inputs[:1]
    return [table, *(_residual_over(residual, test) for test in structured[:_DRAWN_INPUTS])]


def _channel_title(test: InputTest, robot: Robot) -> str:
    """Axis title of the residual's component (axis or joint) with the strongest pattern in a test."""
    if test.channel.joint is not None:
        return joint_title(test.channel.joint, robot)
    return next((title for title, axis in AXES.items() if "xyz"[axis] == test.channel.axis), LENGTH)


def _residual_over(residual: ModelResidual, test: InputTest) -> FigurePlace:
    robot, channel = residual.calibration.dataset.robot, test.channel
    *_, band = shown(residual.pose_errors, _channel_title(test, robot), channel.joint, robot)
    pattern = "No systematic dependence" if test.p_value >= STRUCTURE_LEVEL else "Systematic dependence"
    dependence = f"{pattern} on {input_title(test.input, robot)} (p = {numbers.probability(test.p_value)})"
    part = channel.axis if channel.joint is None else channel.joint + 1
    return FigurePlace(
        "residuals_over",
        (residual.calibration, test.input, part),
        f"Model: {model_name(residual.calibration.model)}. {dependence}. {band_note(residual.pose_errors, band)}",
    )
