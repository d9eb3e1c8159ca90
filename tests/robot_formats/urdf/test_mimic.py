"""Mimic joints as a matrix from commanded to joint values, compared with MuJoCo's positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import load_robot_toml, robot_to_toml
from calib.kinematics.chain import nominal_chain
from calib.robot_formats.calibrated_file import calibrated_urdf
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import read_robot
from tests.support.chains import joint, link, urdf_of
from tests.support.mujoco_arm import mujoco

# A lifting column of two stages, and a parallelogram: the elbow turns back what the shoulder does.
ARM = urdf_of(
    "".join(link(name) for name in ("base", "low", "high", "upper", "fore", "hand", "tip")),
    "".join(
        [
            joint("lift1", "base", "low", "0.1 0 0.4", "0.1 0 0", "0 0 1", "prismatic"),
            joint("lift2", "low", "high", "0 0 0.2", "0 0.2 0", "0 0.6 0.8", "prismatic",
                  '<mimic joint="lift1" multiplier="1.5" offset="0.02"/>'),
            joint("shoulder", "high", "upper", "0 0.1 0.1", "0 0 0.3", "0 1 0"),
            joint("elbow", "upper", "fore", "0.5 0 0", "0.2 0 0", "0 1 0", "continuous",
                  '<mimic joint="shoulder" multiplier="-1" offset="0.25"/>'),
            joint("wrist", "fore", "hand", "0.4 0 0", "0 0.1 0", "1 0 0", "revolute",
                  '<mimic joint="elbow" multiplier="0.5" offset="-0.1"/>'),
            joint("tip_fixed", "hand", "tip", "0.1 0 0", "0 0.3 0", type="fixed"),
        ]
    ),
)  # fmt: skip


def by_mujoco(q: np.ndarray) -> np.ndarray:
    """Tip transforms (N, 4, 4), mm, by MuJoCo from commanded lift1 (m) and shoulder, others by the rule of <mimic>."""
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    text = ARM.replace('"/>\n  <link', f'">{inertial}</link>\n  <link')
    spec = mujoco().MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    model = spec.compile()
    data, out = mujoco().MjData(model), []
    for lift, shoulder in q:
        elbow = -shoulder + 0.25
        values = {"lift1": lift, "lift2": 1.5 * lift + 0.02, "shoulder": shoulder, "elbow": elbow}
        values["wrist"] = 0.5 * elbow - 0.1
        for name, value in values.items():
            data.qpos[model.joint(name).qposadr[0]] = value
        mujoco().mj_kinematics(model, data)
        place = np.eye(4)
        place[:3, :3], place[:3, 3] = data.body("tip").xmat.reshape(3, 3), 1e3 * data.body("tip").xpos
        out.append(place)
    return np.array(out)


def test_followers_are_coupled_and_their_offsets_go_into_the_table(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    found = read_robot(tmp_path / "arm.urdf")
    (tmp_path / "robot.toml").write_text(robot_to_toml(found.robot))
    robot = load_robot_toml(tmp_path / "robot.toml")
    q = np.random.default_rng(0).uniform(-1, 1, (100, 2))
    commanded = np.zeros((100, 5))
    commanded[:, 0], commanded[:, 2] = 1e3 * q[:, 0], q[:, 1]
    joints = robot.joints_of(commanded)
    mine = nominal_chain(robot, joints).base_T_frame[:, -1]
    theirs = by_mujoco(q)
    assert np.abs(mine[:, :3, 3] - theirs[:, :3, 3]).max() < 1e-9
    assert np.abs(mine[:, :3, :3] - theirs[:, :3, :3]).max() < 1e-12
    assert robot.joints[1].max == pytest.approx(2480.0)
    assert "joint elbow follows shoulder (-1 x its value + 0.25)" in found.summary


def test_a_coupled_arm_goes_back_into_its_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    robot = read_robot(path).robot
    assert calibrated_urdf(path, robot).content == path.read_bytes()
    table = robot.table
    table[3] += [0.2, 0.001, -0.3, 0.002, 0.001]
    calibrated = robot.with_table(table)
    written = calibrated_urdf(path, calibrated)
    assert "elbow" in written.changed
    (tmp_path / "again.urdf").write_bytes(written.content)
    again = read_robot(tmp_path / "again.urdf").robot
    q = np.random.default_rng(1).uniform(-1, 1, (20, 5)) * [300, 300, 1, 1, 1]
    places = [nominal_chain(r, r.joints_of(q)).base_T_frame[:, -1] for r in (calibrated, again)]
    assert np.abs(places[0] - places[1]).max() < 1e-9


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'joint="lift1"',
            'joint="finger"',
            r"line 16: joint 'lift2' mimics 'finger', which is no joint between",
        ),
        (
            'joint="lift1"',
            'joint="shoulder"',
            r"line 16: joint 'lift2' mimics 'shoulder', one of which turns",
        ),
        (
            'joint="shoulder"',
            'joint="wrist"',
            r"line \d+: joint 'wrist' mimics itself|joint 'elbow' mimics itself",
        ),
        ('"-1"', '"1e-9"', r"line 28: the multiplier of joint 'elbow' is 1e-09"),
        ('"-1"', '"x"', r"multiplier in the <mimic> of joint 'elbow' is 'x'"),
        ('<mimic joint="lift1"', "<mimic", r"the <mimic> of joint 'lift2' has no joint"),
    ],
)
def test_what_cannot_be_coupled_is_told_with_its_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.replace(old, new, 1))
    with pytest.raises(RobotFileError, match=said):
        read_robot(tmp_path / "arm.urdf")
