"""Robots written as xacro: expanded by the library, refused where no user named the file, errors in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.extras.robot_forms import xacro_files
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from inspector.cli.parser import main

pytest.importorskip("xacrodoc")

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
    return nominal_chain(robot, q).base_T_frame[:, -1]


def run(path: Path, packages: dict[str, Path] | None = None, **arguments: str) -> Robot:
    return read_robot(path, ReadOptions(xacro_args=arguments, packages=packages)).robot


def test_a_xacro_is_the_urdf_that_it_makes(arm: Path, tmp_path: Path) -> None:
    (tmp_path / "hand.urdf").write_text(BY_HAND)
    theirs = read_robot(tmp_path / "hand.urdf").robot
    mine = run(arm, reach="0.45")
    assert np.abs(tips(mine) - tips(theirs)).max() < 1e-12
    assert [(j.name, j.min, j.max) for j in mine.joints] == [(j.name, j.min, j.max) for j in theirs.joints]
    assert mine.name == "arm"


def named(folder: Path, name: str) -> Path:
    """A ROS package of this name in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "package.xml").write_text(f"<package><name> {name} </name></package>")
    return folder


def test_a_package_is_given_or_above_the_file_or_beside_it(arm: Path, tmp_path: Path) -> None:
    expected = tips(run(arm))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (arm.parent / "parts" / "stage.xacro").rename(elsewhere / "stage.xacro")
    arm.write_text(ARM.replace("parts/", "$(find stages)/"))
    with pytest.raises(RobotFileError, match=r"arm\.xacro: xacro: .*give --package stages=FOLDER"):
        run(arm)
    assert np.array_equal(tips(run(arm, {"stages": elsewhere})), expected)
    with pytest.raises(RobotFileError, match="is no folder"):
        run(arm, {"stages": elsewhere / "no"})
    beside = elsewhere.rename(arm.parent / "stages")
    assert np.array_equal(tips(run(arm)), expected)
    beside.rename(tmp_path / "stages")  # beside the package that holds the file
    named(arm.parent, "cell_description")
    assert np.array_equal(tips(run(arm)), expected)
    (tmp_path / "stages" / "stage.xacro").rename(arm.parent / "stage.xacro")
    (tmp_path / "stages").rmdir()
    named(arm.parent, "stages")  # by its package.xml, whatever its folder is called
    assert np.array_equal(tips(run(arm)), expected)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("parts/stage.xacro", "parts/none.xacro", "xacro: .*No such file"),
        ("$(arg reach)", "${height}", "xacro: name 'height' is not defined"),
        ("$(arg reach)", "$(arg none)", "xacro: .*none"),
        ("$(arg reach)", "${1/0}", "xacro: .*division by zero"),
        ("  <link name", "  <xacro:no/><link name", "xacro: unknown macro name: xacro:no"),
        ('n="1" parent="base"', 'n="1" parent="none"', r"arm\.xacro \(expanded\): line \d+: .*names link 'none'"),
        ("</robot>", "", "xacro: .*(no element found|not well-formed)"),
        ("  <link name", '  <xacro:include filename="arm.xacro"/><link name', "xacro: .*circle"),
    ],
)
def test_a_mistake_in_a_xacro_is_one_line(arm: Path, old: str, new: str, said: str) -> None:
    assert old in ARM
    arm.write_text(ARM.replace(old, new, 1))
    with pytest.raises(RobotFileError, match=said) as caught:
        run(arm)
    assert str(caught.value).startswith(str(arm))
    assert "\n" not in str(caught.value)


def test_an_error_in_an_included_file_names_it(arm: Path) -> None:
    (arm.parent / "parts" / "stage.xacro").write_text(MACRO.replace("<xacro:macro", "<xacro:property/><xacro:macro"))
    with pytest.raises(RobotFileError, match=r"arm\.xacro: xacro: in stage\.xacro: "):
        run(arm)


def test_without_leave_or_without_xacrodoc_a_xacro_is_refused(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RobotFileError, match=r"`inspector convert arm\.xacro arm\.urdf`, and give arm\.urdf"):
        read_robot(arm)
    monkeypatch.setattr(xacro_files, "find_spec", lambda name: None)
    with pytest.raises(RobotFileError, match=r"pip install 'robot-calibration-inspector\[xacro\]'"):
        run(arm)


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
    assert "`inspector convert arm.xacro arm.urdf`" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["convert", str(arm), str(out), "--xacro-arg", "reach=0.7"])
    assert "is not NAME:=VALUE" in capsys.readouterr().err


def test_all_that_is_missing_is_told_at_once(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm.write_text(
        ARM.replace(
            "</robot>",
            '<xacro:include filename="$(find hand_description)/hand.xacro"/><link name="$(arg prefix)x"/>'
            '<!-- $(find not_used) --><xacro:include filename="$(find desk_description)/desk.xacro"/></robot>',
        )
    )
    assert main(["convert", str(arm), str(arm.with_suffix(".toml"))]) == 2
    assert (
        capsys.readouterr()
        .err.rstrip()
        .endswith("give --package hand_description=FOLDER --package desk_description=FOLDER --xacro-arg prefix:=VALUE")
    )
