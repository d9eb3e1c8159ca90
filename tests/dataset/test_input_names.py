"""Further columns of poses.csv are inputs by their whole name, whatever it starts with, and no name makes an error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib import calibrate, diagnose
from calib.calibration.pose_errors import pose_errors_of
from calib.calibration.residual_table import residual_table
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.input_names import column_input, joint_input, quantity_of, summed_joints
from calib.dataset_import.columns import meaning_of
from calib.models.fitted_model import FittedModel
from calib.present.names import input_name, input_title
from calib.screening.curves.joint_curves import learn_joint_curves
from calib.screening.curves.smooth_joint_error import CurveModes, SmoothJointError
from tests.support.changed import with_poses
from tests.support.hidden_dataset import arm

ODD_COLUMNS = (
    "torque1_nm", "torque6_nm", "torque1", "torque", "torque99", "link_q2_deg", "temperature_motor_c",
    "load_table_q1_deg", "q1_deg_raw", "q1", "q01_deg", "q1_mm", "q7", "q1-q2", "q9+q8", "q", "q²", "approach_1",
    "approach1x", "approach7", "approach01", "x", "xy", "order", "time", "temperature2_c", "column q1",
)  # fmt: skip


def with_columns(dataset: Dataset, *names: str) -> Dataset:
    """The dataset with further columns of numbers, each in its own order."""
    rng = np.random.default_rng(5)
    columns = pd.DataFrame({name: rng.normal(size=len(dataset.poses)) for name in names})
    return with_poses(dataset, extra=columns)


def test_names_are_taken_apart_whole() -> None:
    assert joint_input("torque12") == ("torque", 11)
    assert joint_input("approach1") == ("approach", 0)
    assert [quantity_of(name) for name in ("q1", "q01", "q0", "q1_deg", "q²", "q٣", "torque")] == [
        "q",
        *[""] * 6,
    ]
    assert summed_joints("q2-q3") == (1, -1.0, 2)
    assert summed_joints("q2-q3-q4") is None
    assert meaning_of("approach1") is not None
    assert meaning_of("approach01") is None


def test_every_odd_column_is_kept_and_offered_under_its_name(tmp_path: Path) -> None:
    write_dataset(with_columns(arm(3), *ODD_COLUMNS), tmp_path / "odd")
    dataset = load_dataset(tmp_path / "odd")
    assert [*dataset.poses.extra.columns] == [*ODD_COLUMNS]
    plain = calibrate(arm(3))
    fitted = calibrate(dataset)
    assert fitted.after.test == plain.after.test
    inputs, before = pose_errors_of(fitted).inputs, pose_errors_of(plain).inputs
    for name, values in before.items():
        np.testing.assert_array_equal(inputs[name], values)
    for name in ODD_COLUMNS:
        np.testing.assert_array_equal(inputs[column_input(name)], dataset.poses.extra[name])
        assert str(input_name(column_input(name))).endswith(name)
        assert input_title(column_input(name), dataset.robot).endswith(name)
    table = residual_table(fitted)
    for name in ODD_COLUMNS:
        kept = [c for c in table.columns if c == name or c.removeprefix("input_") == name]
        assert any(np.array_equal(table[c], dataset.poses.extra[name]) for c in kept), name


@pytest.mark.slow
def test_odd_columns_make_no_error_in_learning_and_in_the_diagnosis() -> None:
    dataset = with_columns(arm(4), *ODD_COLUMNS)
    learn_joint_curves(calibrate(dataset))
    assert diagnose(dataset).verdict == diagnose(arm(4)).verdict


@pytest.mark.parametrize("name", ["time_s", "temperature_c", "payload_kg", "humidity", "torque1_nm", "column q1"])
def test_a_model_with_a_curve_over_a_column_needs_that_column(name: str) -> None:
    dataset = with_columns(arm(3), "humidity", "torque1_nm", "q1")
    n = len(dataset.poses)
    rng = np.random.default_rng(6)
    values = {of: rng.uniform(1.0, 2.0, n) for of in ("temperature_c", "payload_kg", "time_s")}
    dataset = replace(dataset, poses=replace(dataset.poses, **values))
    modes = CurveModes(name, np.array([1]), np.eye(2))
    model = FittedModel.of(calibrate(dataset, effects=(SmoothJointError(1, modes, (1e-4, 1e-4)),)))
    assert model.needs == (name.removeprefix("column "),)
