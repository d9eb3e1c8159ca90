"""Robots written as MuJoCo models and SDF: MuJoCo's own kinematics, and a reader of SDF of the test's own, agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.kinematics.chain import forward, target_points
from calib.kinematics.robot import Robot, Target
from calib.robot_formats.robots import load_robot, save_robot
from inspector.cli.parser import main
from tests.support.arms import random_arm
from tests.support.robot_texts import SDF

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
    out = forward(robot.table, q, robot.is_revolute, robot.base_T_first).base_T_frame[:, -1].copy()
    out[:, :3, 3] /= 1e3
    return out


def tip_by_sdf(path: Path, q: NDArray, names: list[str]) -> NDArray:
    """Poses (N, 4, 4) of tool0 in base_link, m, by a reader of its own of the poses that the file has."""

    def pose(text: str) -> NDArray:
        x, y, z, *rpy = map(float, text.split())
        out = np.eye(4)
        out[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        out[:3, 3] = x, y, z
        return out

    model = ElementTree.parse(path).getroot().find("model")
    assert model is not None
    found = []
    for values in q:
        place, link = np.eye(4), "base_link"
        while link != "tool0":
            joint = next(each for each in model.iter("joint") if each.findtext("parent") == link)
            at = joint.find("pose")
            assert at is not None
            assert at.attrib["relative_to"] == link
            place = place @ pose(at.text or "")
            link = joint.findtext("child") or ""
            child = next(each for each in model.iter("link") if each.attrib["name"] == link).find("pose")
            assert child is not None
            assert child.attrib["relative_to"] == joint.attrib["name"]
            if joint.attrib["type"] != "fixed":
                along = values[names.index(joint.attrib["name"])] * np.array(
                    [float(v) for v in (joint.findtext("axis/xyz") or "").split()]
                )
                move = np.eye(4)
                if joint.attrib["type"] == "revolute":
                    move[:3, :3] = Rotation.from_rotvec(along).as_matrix()
                else:
                    move[:3, 3] = along / 1e3
                place = place @ move
        found.append(place)
    return np.array(found)


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


@pytest.mark.parametrize("arm", ARMS)
def test_an_sdf_holds_the_arm(arm: str, tmp_path: Path) -> None:
    robot = ARMS[arm]
    save_robot(robot, tmp_path / "arm.sdf")
    q = joints(robot)
    names = [joint.name or f"J{k + 1}" for k, joint in enumerate(robot.joints)]
    assert np.abs(tip_by_sdf(tmp_path / "arm.sdf", q, names) - tips(robot, q)).max() < 1e-9


@pytest.mark.parametrize("suffix", [".sdf", pytest.param(".xml", marks=pytest.mark.slow)])
@pytest.mark.parametrize("arm", ARMS)
def test_what_was_written_reads_back(suffix: str, arm: str, tmp_path: Path) -> None:
    if suffix == ".xml":
        pytest.importorskip("mujoco")
    robot = ARMS[arm]
    save_robot(robot, tmp_path / f"arm{suffix}")
    back = load_robot(tmp_path / f"arm{suffix}", base="base_link" if arm == "leaning" else None)
    q = joints(robot)
    assert np.abs(tips(back, q) - tips(robot, q)).max() < 1e-9
    for mine, theirs in zip(robot.joints, back.joints, strict=True):
        assert theirs.min == (None if mine.min is None else pytest.approx(mine.min))
        assert theirs.type == mine.type
    down = np.array(robot.gravity_m_s2) / np.linalg.norm(robot.gravity_m_s2)
    assert np.allclose(np.array(back.gravity_m_s2) / np.linalg.norm(back.gravity_m_s2), down, atol=1e-9)


def test_the_measured_point_is_a_site_and_a_link(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    robot = replace(ARMS["rb5"], targets=(Target("jig", (12.0, -30.0, 44.0)),))
    save_robot(robot, tmp_path / "arm.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    data, q = mujoco.MjData(model), joints(robot, 5)
    for values, point in zip(q, target_points(robot, q), strict=True):
        data.qpos[:] = values
        mujoco.mj_kinematics(model, data)
        assert np.abs(data.site("tool_point").xpos - point / 1e3).max() < 1e-9
    save_robot(robot, tmp_path / "arm.sdf")
    assert "tool_point" in (tmp_path / "arm.sdf").read_text()


def old_tip(q: NDArray) -> NDArray:
    """Places of the hand's origin by turning points about lines in the model's frame, as version 1.4 gives them."""

    def about(point: NDArray, axis: NDArray, angle: float, place: NDArray) -> NDArray:
        return Rotation.from_rotvec(angle * axis).apply(place - point) + point

    hand = Rotation.from_euler("xyz", [-0.4, 0.5, 0.2])
    wrist_at = np.array([0.5, 0.3, 0.9]) + hand.apply([0.05, 0.0, -0.02])
    out = []
    for shoulder, wrist in q:
        place = about(wrist_at, np.array([1.0, 0.0, 0.0]), wrist, np.array([0.5, 0.3, 0.9]))
        out.append(about(np.array([0.2, 0.1, 0.4]), np.array([0.0, 0.6, 0.8]), shoulder, place))
    return np.array(out)


def test_poses_of_the_model_and_axes_in_it_are_understood(tmp_path: Path) -> None:
    (tmp_path / "old.sdf").write_text(SDF)
    robot = load_robot(tmp_path / "old.sdf")
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (30, 2))
    assert np.abs(target_points(robot, q) / 1e3 - old_tip(q)).max() < 1e-9
    assert [joint.name for joint in robot.joints] == ["shoulder", "wrist"]
    assert (robot.joints[0].min, robot.joints[0].max) == (-1.5, 2.0)
    assert robot.joints[1].min is None
    assert robot.joints[0].mass_kg == 2.5


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("<child>upper</child>", "<child>uper</child>", "is 'uper', which is no link"),
        ('type="revolute"><pose>', 'type="ball"><pose>', "joint 'wrist' is of type 'ball'"),
        ("<xyz>1 0 0</xyz>", "<xyz>0 0 0</xyz>", "no direction"),
        ("<pose>0 0 0.1 0 0 0</pose>", "<pose>0 0 0.1</pose>", "a <pose> is '0 0 0.1'; 6 numbers"),
        ("<pose>0 0 0.1 0 0 0</pose>", '<pose relative_to="base">0 0 0 0 0 0</pose>', "depends on itself"),
        ("<pose>0 0 0.1 0 0 0</pose>", '<pose relative_to="x">0 0 0 0 0 0</pose>', "no frame 'x'"),
        ("<mass>2.5</mass>", "<mass>-1</mass>", "weighs -1 kg"),
        ('<link name="base">', '<include/><link name="base">', "includes or nests"),
    ],
)
def test_a_mistake_in_an_sdf_is_one_line(old: str, new: str, says: str, tmp_path: Path) -> None:
    assert old in SDF
    (tmp_path / "bad.sdf").write_text(SDF.replace(old, new, 1))
    with pytest.raises(CalibError, match=r"line [0-9]+: ") as found:
        load_robot(tmp_path / "bad.sdf")
    assert says in str(found.value)


def test_convert_goes_by_the_suffix(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "robot.toml").write_text(Path("calib/robots/rb5.toml").read_text())
    assert main(["convert", str(tmp_path / "robot.toml"), str(tmp_path / "arm.sdf")]) == 0
    assert main(["convert", str(tmp_path / "arm.sdf"), str(tmp_path / "arm.urdf")]) == 0
    assert "reaches the file's own places" in capsys.readouterr().out
    q = joints(ARMS["rb5"])
    assert np.abs(tips(load_robot(tmp_path / "arm.urdf"), q) - tips(ARMS["rb5"], q)).max() < 1e-9
