"""Residuals of a calibration as a table: one row per pose, with every input on which residuals may depend."""

from __future__ import annotations

import numpy as np

from calib.array_types import BoolArray
from calib.calibration.pose_errors import PoseErrors, pose_errors_of
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.dataset.input_names import PLACES, further_inputs, joint_input
from calib.fitting.observations import Observations
from calib.lazy_modules import pd
from calib.statistics import group_means

_DECIMALS = 6  # of mm, degrees and Nm: a nanometre


def residual_table(calibration: Calibration) -> pd.DataFrame:
    """Table with one row per measured pose, in the dataset's order; several points of a pose are averaged.

    Columns: pose, role, setup, points (how many were averaged); error_x_mm ... (predicted minus measured) and its
    length error_mm; predicted_x_mm ... and measured_x_mm ..., all in the scanner's frame; then every input that varies,
    angles in degrees, further columns of poses.csv as they are there. An input whose name is taken becomes input_...
    """
    pose_errors = pose_errors_of(calibration)
    dataset = calibration.dataset
    everything = Observations.of_all(dataset)
    poses, row = everything.used_poses
    measured_mm = group_means(everything.points.xyz_mm, row, len(poses))
    columns: dict[str, object] = {
        "pose": poses.ids,
        "role": poses.role,
        "setup": poses.setup,
        "points": np.bincount(row, minlength=len(poses)),
    }
    for name, values in (
        ("error", pose_errors.error_mm),
        ("predicted", measured_mm + pose_errors.error_mm),
        ("measured", measured_mm),
    ):
        columns |= {f"{name}_{axis}_mm": values[:, k].round(_DECIMALS) for k, axis in enumerate("xyz")}
        if name == "error":
            columns["error_mm"] = np.linalg.norm(values, axis=1).round(_DECIMALS)
    for name, values_of_input in _inputs(pose_errors, poses, dataset.robot.is_revolute).items():
        while name in columns:
            name = f"input_{name}"
        columns[name] = values_of_input
    return pd.DataFrame(columns)


def _inputs(pose_errors: PoseErrors, poses: Poses, is_revolute: BoolArray) -> dict[str, object]:
    """Values (N,) of the inputs on which residuals may depend, by column name."""
    named: dict[str, object] = {}
    columns = further_inputs(poses)
    for name, values in pose_errors.inputs.items():
        quantity, joint = joint_input(name) or ("", 0)
        if name in columns:
            named[columns[name]] = poses.extra.by_name[columns[name]]  # texts, not the numbers that replace them
        elif quantity == "q":
            turns = bool(is_revolute[joint])
            named[f"{name}_{'deg' if turns else 'mm'}"] = (np.degrees(values) if turns else values).round(_DECIMALS)
        elif quantity == "torque":
            named[f"{name}_nm"] = values.round(_DECIMALS)
        elif name not in PLACES:
            named[name] = values
    return named
