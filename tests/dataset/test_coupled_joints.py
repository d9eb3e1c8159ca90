"""Coupled joints, `coupling` in robot.toml: joint values from commanded ones, commanded targets from joint values."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import load_robot_toml, robot_to_toml
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from tests.support.arms import dataset_of, jang_arm, perturbed, random_arm
from tests.support.commands import answered

COUPLING = np.eye(6)
COUPLING[2, 1] = 1.0  # q3 = q2 + q3', a parallelogram
COUPLING[5, 4] = -0.5


def coupled(robot: Robot) -> Robot:
    return replace(robot, coupling=tuple(map(tuple, COUPLING.tolist())))


@pytest.fixture
def dataset() -> Dataset:
    rng = np.random.default_rng(4)
    nominal = jang_arm()
    return dataset_of(nominal, perturbed(nominal, rng), rng, poses=30, test=8)


def test_files_hold_what_is_commanded_and_the_model_what_the_joints_do(dataset: Dataset, tmp_path: Path) -> None:
    write_dataset(replace(dataset, robot=coupled(dataset.robot)), tmp_path)
    commanded = np.radians(pd.read_csv(tmp_path / "poses.csv")[[f"q{k + 1}_deg" for k in range(6)]])
    np.testing.assert_allclose(commanded["q3_deg"], dataset.poses.q[:, 2] - dataset.poses.q[:, 1], atol=1e-12)
    np.testing.assert_allclose(commanded["q6_deg"], dataset.poses.q[:, 5] + 0.5 * dataset.poses.q[:, 4], atol=1e-12)
    back = load_dataset(tmp_path)
    np.testing.assert_allclose(back.poses.q, dataset.poses.q, atol=1e-12)
    one, other = calibrate(dataset).after.test, calibrate(back).after.test
    assert max(one.rmse_mm, other.rmse_mm) < 1e-9  # without noise
    # Without the matrix the same files are of another arm.
    (tmp_path / "robot.toml").write_text(robot_to_toml(dataset.robot))
    wrong = calibrate(load_dataset(tmp_path)).after.test
    assert wrong.rmse_mm > 1.0


def test_corrected_targets_are_commanded_ones(dataset: Dataset, tmp_path: Path) -> None:
    """Joint values at corrected targets equal those of the same arm without coupling."""
    found = {}
    for name, robot in (("plain", dataset.robot), ("coupled", coupled(dataset.robot))):
        folder = tmp_path / name
        write_dataset(replace(dataset, robot=robot), folder)
        targets, out = folder / "targets.csv", folder / "corrected.csv"
        q = robot.commands_of(dataset.poses.q[:5])
        pd.DataFrame(np.degrees(q), columns=[f"q{k + 1}_deg" for k in range(6)]).to_csv(targets, index=False)
        document = answered("correct", folder, "--joints", targets, "--out", out)
        written = np.radians(pd.read_csv(out)[[f"q{k + 1}_deg" for k in range(6)]].to_numpy())
        np.testing.assert_allclose([t["q"] for t in document["targets"]], written, atol=1e-12)
        found[name] = robot.joints_of(written)
    np.testing.assert_allclose(found["coupled"], found["plain"], atol=1e-9)
    assert np.abs(found["plain"] - dataset.poses.q[:5]).max() > 1e-4


def test_limits_are_the_joints_own(dataset: Dataset, tmp_path: Path) -> None:
    joints = list(dataset.robot.joints)
    joints[2] = replace(joints[2], min=-10.0, max=float(dataset.poses.q[:, 2].max()) + 1e-6)
    robot = coupled(replace(dataset.robot, joints=tuple(joints)))
    write_dataset(replace(dataset, robot=robot), tmp_path)
    assert load_dataset(tmp_path).warnings == ()


def test_the_matrix_survives_writing(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(robot_to_toml(coupled(jang_arm())))
    assert load_robot_toml(path).coupling == coupled(jang_arm()).coupling


def test_a_screw_and_a_zero_are_in_degrees_in_the_file(tmp_path: Path) -> None:
    arm = random_arm(np.random.default_rng(1), 2, prismatic=1)
    slide = int(np.argmin(arm.is_revolute))
    coupling = np.eye(2)
    coupling[slide, 1 - slide] = 20.0 / (2.0 * np.pi)  # mm per rad
    zeros = np.where(arm.is_revolute, np.pi / 2.0, 3.0)
    path = tmp_path / "robot.toml"
    path.write_text(robot_to_toml(arm.with_commands(coupling, zeros)))
    back = load_robot_toml(path)
    quarter = np.where(arm.is_revolute, np.pi / 2.0, 0.0)
    expected = np.where(arm.is_revolute, np.pi, 8.0)  # mm: a zero of 3 and a quarter of the pitch
    np.testing.assert_allclose(back.joints_of(quarter), expected, atol=1e-12)
    np.testing.assert_allclose(back.commands_of(expected), quarter, atol=1e-12)
    assert "0.0555555" in path.read_text()


@pytest.mark.parametrize(
    ("matrix", "says"),
    [
        ([[1.0, 0.0]], "3 rows of 3 finite numbers are needed"),
        ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, "1", 1.0]], "3 rows of 3 finite numbers are needed"),
        ([1.0, 2.0, 3.0], "3 rows of 3 finite numbers are needed"),
        ([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "which has no inverse"),
    ],
)
def test_a_matrix_that_is_none_is_refused(tmp_path: Path, matrix: object, says: str) -> None:
    path = tmp_path / "robot.toml"
    text = robot_to_toml(random_arm(np.random.default_rng(1), 3, prismatic=2))
    path.write_text(f"coupling = {json.dumps(matrix)}\n{text}")
    with pytest.raises(DatasetError) as caught:
        load_robot_toml(path)
    assert "coupling: " in str(caught.value)
    assert says in str(caught.value)
