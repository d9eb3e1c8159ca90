"""A xacro, expanded in a process that reads its own folder and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.kinematics.chain import forward
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import Reading, read_robot
from calib.robot_formats.urdf import xacro as module
from calib.robot_formats.urdf.xacro import Xacro
from inspector.cli.parser import main

pytestmark = pytest.mark.slow  # a process each

HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
MACRO = (
    HEAD
    + """  <xacro:macro name="stage" params="n parent *origin">
    <link name="link${n}"/>
    <joint name="joint${n}" type="revolute">
      <parent link="${parent}"/> <child link="link${n}"/>
      <xacro:insert_block name="origin"/>
      <axis xyz="0 ${n % 2} ${1 - n % 2}"/>
      <limit lower="-2" upper="${pi / 2}" effort="1" velocity="1"/>
    </joint>
  </xacro:macro>
</robot>
"""
)
ARM = (
    HEAD
    + """  <xacro:include filename="parts/stage.xacro"/>
  <xacro:arg name="reach" default="0.3"/>
  <xacro:property name="sizes" value="${xacro.load_yaml('sizes.yaml')}"/>
  <link name="base"/>
  <xacro:stage n="1" parent="base"><origin xyz="0 0 ${sizes['height']}"/></xacro:stage>
  <xacro:stage n="2" parent="link1"><origin xyz="$(arg reach) 0 0" rpy="0.1 0 0"/></xacro:stage>
</robot>
"""
)
BY_HAND = """<robot name="arm"><link name="base"/><link name="link1"/><link name="link2"/>
<joint name="joint1" type="revolute"><parent link="base"/><child link="link1"/><origin xyz="0 0 0.25"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="1.5707963267948966"/></joint>
<joint name="joint2" type="revolute"><parent link="link1"/><child link="link2"/><origin xyz="0.45 0 0" rpy="0.1 0 0"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="1.5707963267948966"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    cell = tmp_path / "cell"
    (cell / "parts").mkdir(parents=True)
    (cell / "parts" / "stage.xacro").write_text(MACRO)
    (cell / "sizes.yaml").write_text("height: 0.25\n")
    (cell / "arm.xacro").write_text(ARM)
    return cell / "arm.xacro"


def tips(robot: Robot) -> np.ndarray:
    q = np.random.default_rng(0).uniform(-2, 2, (20, robot.n_joints))
    return forward(robot.table, q, robot.is_revolute, robot.base_T_first).base_T_frame[:, -1]


def test_a_xacro_is_the_urdf_that_it_makes(arm: Path, tmp_path: Path) -> None:
    (tmp_path / "hand.urdf").write_text(BY_HAND)
    theirs = read_robot(tmp_path / "hand.urdf").robot
    mine = read_robot(arm, Reading(xacro=Xacro({"reach": "0.45"}))).robot
    assert np.abs(tips(mine) - tips(theirs)).max() < 1e-12
    assert [(j.name, j.min, j.max) for j in mine.joints] == [(j.name, j.min, j.max) for j in theirs.joints]


def test_a_package_is_a_folder_that_was_named(arm: Path, tmp_path: Path) -> None:
    package = tmp_path / "elsewhere"
    package.mkdir()
    (arm.parent / "parts" / "stage.xacro").rename(package / "stage.xacro")
    arm.write_text(ARM.replace("parts/", "$(find stages)/"))
    with pytest.raises(RobotFileError, match=r"arm\.xacro: line 2: .*give --xacro-package stages=FOLDER"):
        read_robot(arm, Reading(xacro=Xacro()))
    assert read_robot(arm, Reading(xacro=Xacro(packages={"stages": package}))).robot.n_joints == 2
    with pytest.raises(RobotFileError, match="is no folder"):
        read_robot(arm, Reading(xacro=Xacro(packages={"stages": package / "no"})))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "parts/stage.xacro",
            "../secret.xacro",
            "line 2: names .*secret.xacro', which is not below its folder",
        ),
        ("parts/stage.xacro", "/etc/passwd", "line 2: names '/etc/passwd', which is not below"),
        ("parts/stage.xacro", "link.xacro", "line 2: names .*link.xacro', which is not below"),
        ("parts/stage.xacro", "../*.xacro", "line 2: .*which is not below its folder"),
        ("parts/stage.xacro", "parts/none.xacro", "line 2: .*No such file"),
        (
            "'sizes.yaml'",
            "'../secret.xacro'",
            r"line 6: names .*/secret\.xacro', which is not below",
        ),
        ("$(arg reach)", "$(env HOME)", "line 7: .*environment variable 'HOME' is not set"),
        ("$(arg reach)", "${().__class__}", "line 7: Use of invalid name"),
        ("$(arg reach)", "${height}", "line 7: name 'height' is not defined"),
        ("  <link name", "  <xacro:no/><link name", "line 5: unknown macro name: xacro:no"),
        ('n="1" parent="base"', 'n="1" parent="none"', r"line 5 of .*stage\.xacro: .*names link 'none'"),
        ("</robot>", "", r"line \d+: .*(no element found|not well-formed)"),
        (HEAD, '<!DOCTYPE a [<!ENTITY x "y">]>\n' + HEAD, "has a DOCTYPE"),
    ],
)
def test_what_a_xacro_may_not_do_is_told_with_file_and_line(arm: Path, old: str, new: str, said: str) -> None:
    (arm.parent.parent / "secret.xacro").write_text(MACRO)
    (arm.parent / "link.xacro").symlink_to(arm.parent.parent / "secret.xacro")
    arm.write_text(ARM.replace(old, new, 1))
    with pytest.raises(RobotFileError, match=said) as caught:
        read_robot(arm, Reading(xacro=Xacro()))
    assert str(caught.value).startswith(str(arm))
    assert "\n" not in str(caught.value)


def test_a_xacro_without_end_is_given_up(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_SECONDS", 3)
    arm.write_text(ARM.replace("$(arg reach)", "${sum([1 for i in range(10**12)])}", 1))
    with pytest.raises(RobotFileError, match=r"not done after 3 s|line 7"):
        read_robot(arm, Reading(xacro=Xacro()))
    arm.write_text(HEAD + '<xacro:macro name="a"><xacro:a/></xacro:macro><xacro:a/></robot>')
    with pytest.raises(RobotFileError, match="round in a circle"):
        read_robot(arm, Reading(xacro=Xacro()))


def test_without_leave_or_without_xacrodoc_a_xacro_is_refused(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RobotFileError, match="line 2: found <xacro:include>, a macro that is not expanded"):
        read_robot(arm)
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    with pytest.raises(RobotFileError, match=r"pip install 'robot-calibration-inspector\[xacro\]'"):
        read_robot(arm, Reading(xacro=Xacro()))


def test_the_commands_expand_what_is_named_and_nothing_else(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "robot.toml"
    assert main(["convert", str(arm), str(out), "--xacro-arg", "reach:=0.7"]) == 0
    (tmp_path / "hand.urdf").write_text(BY_HAND.replace("0.45", "0.7"))
    theirs = tips(read_robot(tmp_path / "hand.urdf").robot)
    assert np.abs(tips(read_robot(out).robot) - theirs).max() < 1e-9
    assert "joint1, joint2" in capsys.readouterr().out
    (arm.parent / "joints.csv").write_text("q1_deg,q2_deg,x_mm,y_mm,z_mm\n0,0,1,2,3\n")
    cell = tmp_path / "made"
    assert main(["import", str(cell), "--from", str(arm.parent)]) == 2
    assert "a macro that is not expanded" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["convert", str(arm), str(out), "--xacro-arg", "reach=0.7"])
    assert "is not NAME:=VALUE" in capsys.readouterr().err
