"""[base] of robot.toml: where the first row starts, in the base frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import calibrate
from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, robot_to_toml
from calib.effects.gravity import GravityLoads
from calib.errors import DatasetError
from calib.frames import rotation_from_rpy, rpy_from_rotation
from calib.kinematics.chain import forward, nominal_chain, point_jacobian
from calib.kinematics.robot import FixedFrame, Robot
from calib.simulation.simulate import simulate_dataset
from tests.support.mujoco_arm import in_mujoco, mujoco_model

BASE = FixedFrame((120.0, -40.0, 700.0), (0.3, -0.7, 2.1))


def on_base() -> Robot:
    return replace(builtin_robot("rb5"), base=BASE)


@pytest.mark.parametrize(
    "pitch",
    [
        0.0,
        0.4,
        -1.2,
        np.pi / 2,
        -np.pi / 2,
        np.pi / 2 - 1e-9,
        np.pi / 2 - 1e-12,
        np.pi / 2 + 3e-15,
        np.pi / 2 - 1e-5,
    ],
)
def test_roll_pitch_yaw_turn_about_fixed_axes_and_come_back(pitch: float) -> None:
    rng = np.random.default_rng(4)
    for roll, yaw in rng.uniform(-np.pi, np.pi, (50, 2)):
        rotation = rotation_from_rpy([roll, pitch, yaw])
        assert rotation == pytest.approx(Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix(), abs=1e-15)
        assert rotation_from_rpy(rpy_from_rotation(rotation)) == pytest.approx(rotation, abs=1e-15)


def test_the_jacobian_is_that_of_the_moved_arm() -> None:
    robot = on_base()
    q = np.array([[0.3, -0.8, 1.1, 0.2, -0.5, 0.9]])

    def tool(table: np.ndarray) -> np.ndarray:
        return forward(table, q, robot.is_revolute, robot.base_T_first).target_mm[0]

    chain = nominal_chain(robot, q)
    jacobian = point_jacobian(chain, chain.target_mm)[0]
    for row, kind in ((0, 1), (2, 3), (3, 0), (4, 4), (6, 2)):
        step = np.zeros_like(robot.table)
        step[row, kind] = 1e-4
        numeric = (tool(robot.table + step) - tool(robot.table - step)) / 2e-4
        assert jacobian[:, row, kind] == pytest.approx(numeric, abs=1e-5)


def test_gravity_is_given_in_the_base_frame() -> None:
    robot = on_base()
    q = np.random.default_rng(1).uniform(-2, 2, (4, robot.n_joints))
    chain = nominal_chain(robot, q)
    model = mujoco_model(robot)
    for torques, values in zip(GravityLoads(robot, chain, None).joint_torques, q, strict=True):
        data = in_mujoco(model, robot, values)
        assert torques == pytest.approx(-data.qfrc_bias, abs=1e-9)


def test_the_file_keeps_it_and_is_as_before_without(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(robot_to_toml(on_base()))
    again = load_robot_toml(path)
    assert again.base.xyz_mm == BASE.xyz_mm
    assert again.base.rpy_rad == pytest.approx(BASE.rpy_rad, abs=1e-14)
    assert "base" not in robot_to_toml(builtin_robot("rb5"))


def test_an_unknown_key_of_the_base_is_named(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(robot_to_toml(on_base()).replace("rpy_deg", "rpy_rad"))
    with pytest.raises(DatasetError, match=r"robot\.toml: \[base\]\.rpy_rad: no such key"):
        load_robot_toml(path)


def test_a_fit_does_not_depend_on_where_the_base_frame_is() -> None:
    found = []
    for robot in (builtin_robot("rb5"), on_base()):
        dataset = simulate_dataset("rb5", rng=3, poses=20, noise_mm=0.02).dataset
        found.append(calibrate(replace(dataset, robot=robot)))
    plain, moved = found
    assert moved.after.train.rmse_mm == pytest.approx(plain.after.train.rmse_mm, rel=1e-6)
    assert moved.robot.table == pytest.approx(plain.robot.table, abs=1e-6)
    assert moved.robot.base == BASE
