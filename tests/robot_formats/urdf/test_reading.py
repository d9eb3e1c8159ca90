"""Reading of URDF: positions and torques as MuJoCo's from the same text, and errors that name link or joint."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.effects.gravity import GravityLoads
from calib.kinematics.chain import nominal_chain
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from tests.support.chains import joint, link, shoulder_arm, urdf_of
from tests.support.mujoco_arm import mujoco


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return path


def in_mujoco(text: str) -> Any:
    spec = mujoco().MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass = 0.0
    return spec.compile()


def test_places_and_torques_are_those_of_mujoco(tmp_path: Path) -> None:
    text = shoulder_arm()
    found = read_robot(written(tmp_path, text), ReadOptions(tip="tool0"))
    robot = found.robot
    assert [j.name for j in robot.joints] == ["pan", "lift", "elbow", "slide", "roll"]
    finger = 'name="finger_slide" type='  # at zero for MuJoCo too
    model = in_mujoco(text.replace(f'{finger}"prismatic"', f'{finger}"fixed"'))
    tip = mujoco().mj_name2id(model, mujoco().mjtObj.mjOBJ_BODY, "tool0")
    rng = np.random.default_rng(0)
    for _ in range(30):
        q = rng.uniform(-2, 2, 5) * np.where(robot.is_revolute, 1.0, 300.0)
        data = mujoco().MjData(model)
        data.qpos[:] = np.where(robot.is_revolute, q, q / 1e3)
        mujoco().mj_forward(model, data)
        chain = nominal_chain(robot, q[None])
        assert np.abs(chain.target_mm[0] - 1e3 * data.xpos[tip]).max() < 1e-9
        assert np.abs(chain.base_T_frame[0, -1, :3, :3] - data.xmat[tip].reshape(3, 3)).max() < 1e-12
        assert np.abs(GravityLoads(robot, chain, None).joint_torques[0] + data.qfrc_bias).max() < 1e-9


def test_what_hangs_on_a_base_in_the_middle_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, shoulder_arm())
    whole, part = (read_robot(path, ReadOptions(tip="tool0", base=base)).robot for base in (None, "base_link"))
    q = np.random.default_rng(1).uniform(-1, 1, (5, 5))
    loads = [GravityLoads(r, nominal_chain(r, q), None).joint_torques for r in (whole, part)]
    assert loads[0] == pytest.approx(loads[1], abs=1e-9)
    assert part.gravity_m_s2 != whole.gravity_m_s2
    late = read_robot(path, ReadOptions(tip="tool0", base="shoulder"))
    assert [j.name for j in late.robot.joints] == ["lift", "elbow", "slide", "roll"]
    assert "with pan at zero" in late.summary


def test_limits_masses_and_names(tmp_path: Path) -> None:
    found = read_robot(written(tmp_path, shoulder_arm()), ReadOptions(tip="tool0"))
    pan, lift, _, slide, _ = found.robot.joints
    assert (pan.min, pan.max) == (-2.5, 2.5)
    assert (lift.min, lift.max) == (None, None)
    assert (slide.type, slide.min, slide.max) == ("prismatic", -2500.0, 2500.0)
    assert [j.mass_kg for j in found.robot.joints] == pytest.approx([3.7, 9.6, 2.3, 1.2, 1.1])
    assert found.robot.extra["source"] == {"file": "arm.urdf", "base": "world", "tip": "tool0"}
    assert "finger_slide" in found.summary


@pytest.mark.parametrize("limit", ["lower='0' upper='0'", "lower='-1e5' upper='1e5'", "effort='1'"])
def test_limits_that_say_nothing_are_none(tmp_path: Path, limit: str) -> None:
    text = urdf_of(link("a") + link("b"), joint("j", "a", "b", type="continuous", more=f"<limit {limit}/>"))
    path = written(tmp_path, text.replace("continuous", "revolute"))
    (only,) = read_robot(path).robot.joints
    assert (only.min, only.max) == (None, None)


def test_a_urdf_without_masses_gives_none(tmp_path: Path) -> None:
    text = urdf_of(link("a") + link("b"), joint("j", "a", "b"))
    (only,) = read_robot(written(tmp_path, text)).robot.joints
    assert only.mass_kg is None


def test_the_default_axis_is_x(tmp_path: Path) -> None:
    text = urdf_of(
        link("a") + link("b") + link("c"),
        joint("j", "a", "b", axis=None) + joint("f", "b", "c", "0 1 0", type="fixed"),
    )
    robot = read_robot(written(tmp_path, text)).robot
    chain = nominal_chain(robot, [[math.pi / 2]])
    assert chain.target_mm[0] == pytest.approx([0, 0, 1000], abs=1e-9)


AB = link("a") + link("b") + link("c")
REFUSED = {
    "several tips": (
        AB,
        joint("j", "a", "b") + joint("k", "a", "c"),
        "several tips; choose one with --tip: b, c",
    ),
    "a mimic joint": (
        AB,
        joint("j", "a", "b") + joint("k", "b", "c", more='<mimic joint="l"/>'),
        r"line 12: joint 'k' mimics 'l', which is no joint between",
    ),
    "a floating joint": (
        AB,
        joint("j", "a", "b", type="floating") + joint("k", "b", "c"),
        "joint 'j' is floating",
    ),
    "a planar joint": (AB, joint("j", "a", "b") + joint("k", "b", "c", type="planar"), "joint 'k' is planar"),
    "a closed loop": (
        AB,
        joint("j", "a", "b") + joint("k", "b", "c") + joint("l", "a", "c"),
        "link 'c' hangs on joints 'k' and 'l'",
    ),
    "no root": (AB, joint("j", "a", "b") + joint("k", "b", "a"), "several tips|no joint moves|loop"),
    "nothing that moves": (AB, joint("j", "a", "b", type="fixed"), "no joint moves"),
    "a link that is not there": (AB, joint("j", "a", "d"), "names link 'd', which the file does not have"),
    "an axis without direction": (
        AB,
        joint("j", "a", "b", axis="0 0 0"),
        "line 10: the axis of joint 'j' has no",
    ),
    "two numbers": (
        AB,
        joint("j", "a", "b", xyz="0 0"),
        "xyz in the <origin> of joint 'j' is '0 0'; 3 numbers",
    ),
    "not finite": (AB, joint("j", "a", "b", rpy="0 nan 0"), "rpy in the <origin> of joint 'j'"),
    "an unknown type": (AB, joint("j", "a", "b", type="screw"), "is of type 'screw'; expected revolute"),
    "a joint twice": (AB, joint("j", "a", "b") + joint("j", "b", "c"), "joint 'j' stands there twice"),
    "a link twice": (AB + link("a"), joint("j", "a", "b"), "line 6: link 'a' stands there twice"),
    "a macro": (AB + "<xacro:arm/>", joint("j", "a", "b"), "a macro that is not expanded; .*run `xacro"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_the_file_and_what_is_in_the_way(tmp_path: Path, name: str) -> None:
    links, joints, said = REFUSED[name]
    with pytest.raises(RobotFileError, match=said) as caught:
        read_robot(written(tmp_path, urdf_of(links, joints)))
    assert str(caught.value).startswith(str(tmp_path / "arm.urdf"))
    assert "\n" not in str(caught.value)


def test_a_loop_apart_from_the_root_is_no_hang(tmp_path: Path) -> None:
    text = urdf_of(AB + link("d"), joint("j", "a", "b") + joint("k", "c", "d") + joint("l", "d", "c"))
    assert read_robot(written(tmp_path, text)).robot.n_joints == 1
    with pytest.raises(RobotFileError, match="loop"):
        read_robot(written(tmp_path, text), ReadOptions(tip="d"))


BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
UNSAFE = {
    "entities": (BOMB, "line 1: has a DOCTYPE"),
    "another file": ('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot>&x;</robot>', "DOCTYPE"),
    "depth": ("<robot>" + "<a>" * 500, "too many levels"),
    "cut off": (shoulder_arm()[:700], "not valid XML"),
    "nothing": ("", "not valid XML"),
    "another file's kind": ("<html/>", "begins with <html>"),
    "unknown entity": ('<robot name="&x;"/>', "line 1: not valid XML"),
}


@pytest.mark.parametrize("name", UNSAFE)
def test_unsafe_or_broken_xml_is_refused_with_its_line(tmp_path: Path, name: str) -> None:
    text, said = UNSAFE[name]
    with pytest.raises(RobotFileError, match=said):
        read_robot(written(tmp_path, text))


def test_utf_16_and_missing_files_are_told(tmp_path: Path) -> None:
    path = written(tmp_path, "")
    path.write_bytes(shoulder_arm().encode("utf-16"))
    with pytest.raises(RobotFileError, match="UTF-16"):
        read_robot(path)
    with pytest.raises(RobotFileError, match="No such file"):
        read_robot(tmp_path / "none.urdf")
    with pytest.raises(RobotFileError, match="no such file, and no built-in robot"):
        read_robot(tmp_path / "robot.step")
