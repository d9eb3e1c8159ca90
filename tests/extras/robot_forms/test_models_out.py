"""Robots written as MuJoCo models: MuJoCo's own kinematics agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.kinematics.chain import nominal_chain, target_points
from calib.kinematics.robot import Robot, Target
from calib.robot_formats.robots import load_robot, save_robot
from tests.support.arms import random_arm

ARMS = {
    "rb5": builtin_robot("rb5"),
    "panda": builtin_robot("panda"),
    "a slide": random_arm(np.random.default_rng(3), 5, prismatic=2),
    "leaning": replace(builtin_robot("rb5"), gravity_m_s2=(3.0, 0.0, -9.0)),
}


def joints(robot: Robot, count: int = 40) -> NDArray:
    span = np.where(robot.is_revolute, np.pi, 300.0)
    return np.random.default_rng(1).uniform(-span, span, (count, robot.n_joints))


def tips(robot: Robot, q: NDArray) -> NDArray:
    """Poses (N, 4, 4) of the tip, m."""
    out = nominal_chain(robot, q).base_T_frame[:, -1].copy()
    out[:, :3, 3] /= 1e3
    return out


@pytest.mark.parametrize("arm", ARMS)
def test_mujoco_loads_the_model_and_agrees(arm: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    robot = ARMS[arm]
    save_robot(robot, tmp_path / "arm.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, q = mujoco.MjData(model), joints(robot)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "attachment_site")
    for values, tip in zip(q, tips(robot, q), strict=True):
        data.qpos[:] = np.where(robot.is_revolute, values, values / 1e3)
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.site_xpos[site] - tip[:3, 3]).max() < 1e-9
        assert np.abs(data.site_xmat[site].reshape(3, 3) - tip[:3, :3]).max() < 1e-9
    assert np.allclose(model.opt.gravity, robot.gravity_m_s2)
    for k, joint in enumerate(robot.joints):
        if joint.min is not None and joint.max is not None:
            assert np.allclose(model.jnt_range[k] * (1.0 if joint.is_revolute else 1e3), [joint.min, joint.max])


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_what_was_written_reads_back(arm: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    robot = ARMS[arm]
    save_robot(robot, tmp_path / "arm.xml")
    back = load_robot(tmp_path / "arm.xml", base="base_link" if arm == "leaning" else None)
    q = joints(robot)
    assert np.abs(tips(back, q) - tips(robot, q)).max() < 1e-9
    for mine, theirs in zip(robot.joints, back.joints, strict=True):
        assert theirs.min == (None if mine.min is None else pytest.approx(mine.min))
        assert theirs.type == mine.type
    down = np.array(robot.gravity_m_s2) / np.linalg.norm(robot.gravity_m_s2)
    assert np.allclose(np.array(back.gravity_m_s2) / np.linalg.norm(back.gravity_m_s2), down, atol=1e-9)


def test_the_measured_point_is_a_site(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    robot = replace(ARMS["rb5"], targets=(Target("jig", (12.0, -30.0, 44.0)),))
    save_robot(robot, tmp_path / "arm.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, q = mujoco.MjData(model), joints(robot, 5)
    for values, point in zip(q, target_points(robot, q), strict=True):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.site("tool_point").xpos - point / 1e3).max() < 1e-9


@pytest.mark.parametrize(("name", "says"), [("arm.sdf", "give the arm's URDF"), ("arm.srdf", "as --base and --tip")])
def test_forms_that_are_not_read_say_what_to_give(name: str, says: str) -> None:
    with pytest.raises(CalibError, match=says):
        load_robot(name)
