"""Expansion of xacro files in a process that can read its own folder only."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from calib.kinematics.chain import forward
from calib.kinematics.robot import Robot
from calib.robot_formats.chain.serial_chain import RobotFileError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from calib.robot_formats.urdf import xacro as module
from calib.robot_formats.urdf.safe_xml import Element, parse_xml
from calib.robot_formats.urdf.xacro import Xacro
from inspector.cli.parser import main
from tests.support.sweeps import sweep

pytest.importorskip("xacrodoc")
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
    mine = read_robot(arm, ReadOptions(xacro=Xacro({"reach": "0.45"}))).robot
    assert np.abs(tips(mine) - tips(theirs)).max() < 1e-12
    assert [(j.name, j.min, j.max) for j in mine.joints] == [(j.name, j.min, j.max) for j in theirs.joints]


def test_a_package_is_a_folder_that_was_named(arm: Path, tmp_path: Path) -> None:
    package = tmp_path / "elsewhere"
    package.mkdir()
    (arm.parent / "parts" / "stage.xacro").rename(package / "stage.xacro")
    arm.write_text(ARM.replace("parts/", "$(find stages)/"))
    with pytest.raises(RobotFileError, match=r"arm\.xacro: line 2: .*give --package stages=FOLDER"):
        read_robot(arm, ReadOptions(xacro=Xacro()))
    assert read_robot(arm, ReadOptions(xacro=Xacro(packages={"stages": package}))).robot.n_joints == 2
    with pytest.raises(RobotFileError, match="is no folder"):
        read_robot(arm, ReadOptions(xacro=Xacro(packages={"stages": package / "no"})))


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
        ("$(arg reach)", "${().__class__}", "line 7: '__class__' behind a dot"),
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
        read_robot(arm, ReadOptions(xacro=Xacro()))
    assert str(caught.value).startswith(str(arm))
    assert "\n" not in str(caught.value)


def test_a_xacro_without_end_is_given_up(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_SECONDS", 3)
    arm.write_text(ARM.replace("$(arg reach)", "${sum([1 for i in range(10**12)])}", 1))
    with pytest.raises(RobotFileError, match=r"not done after 3 s|line 7"):
        read_robot(arm, ReadOptions(xacro=Xacro()))
    arm.write_text(HEAD + '<xacro:macro name="a"><xacro:a/></xacro:macro><xacro:a/></robot>')
    with pytest.raises(RobotFileError, match="round in a circle"):
        read_robot(arm, ReadOptions(xacro=Xacro()))


def test_without_leave_or_without_xacrodoc_a_xacro_is_refused(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RobotFileError, match="line 2: found <xacro:include>, a macro that is not expanded"):
        read_robot(arm)
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    with pytest.raises(RobotFileError, match=r"pip install 'robot-calibration-inspector\[xacro\]'"):
        read_robot(arm, ReadOptions(xacro=Xacro()))


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


def with_reach(expression: str, before: str = "") -> str:
    """Xacro of the arm with an expression as its reach."""
    return ARM.replace("  <link name", f"{before}\n  <link name", 1).replace("$(arg reach)", expression, 1)


def doubled(times: int) -> str:
    """Xacro properties, each twice as long as the one before."""
    return '<xacro:property name="p0" value="aaaaaaaa"/>' + "".join(
        f'<xacro:property name="p{k}" value="${{p{k - 1}}}${{p{k - 1}}}"/>' for k in range(1, times)
    )


OUT_OF_THE_MODULE = "xacro.load_yaml.__globals__['sys'].modules['__main__']._HARMLESS"
RUNS = f"(lambda: {OUT_OF_THE_MODULE}.add('os.system') or xacro.load_yaml.__globals__['os'].system('touch ran'))()"
HOSTILE = {
    "a function of its own": with_reach(f"${{{RUNS}}}"),
    "globals of a function": with_reach("${xacro.load_yaml.__globals__}"),
    "eval": with_reach("$(eval ().__class__)"),
    "eval that imports": with_reach("$(eval __import__('os').system('touch ran'))"),
    "an escaped expression, which the second run sees": with_reach(f"$${{{RUNS}}}"),
    "a property that makes an expression": with_reach("${q}", "<xacro:property name='q' value='$${().__class__}'/>"),
    "an argument that makes an expression": with_reach("${$(arg z)}", "<xacro:arg name='z' default='().__class__'/>"),
    "a namespace's insides": with_reach("${foo.parent.root}", '<xacro:include filename="none.xacro" ns="foo"/>'),
    "a global name that is overwritten": with_reach(
        "${xacro.load_yaml('sizes.yaml')}", '<xacro:property name="xacro" value="1"/>'
    ),
    "a text that doubles": with_reach("${p59}", doubled(60)),
    "a text of a billion characters": with_reach("${'%1000000000d' % 1}"),
    "a power of a power": with_reach("${10**10**10}"),
    "a YAML tag that makes an object": with_reach("${xacro.load_yaml('object.yaml')['x']}"),
    "a unit that is an expression": with_reach("${xacro.load_yaml('unit.yaml')['x']}"),
    "aliases of aliases": with_reach("${xacro.load_yaml('bomb.yaml')['a14']}"),
    "a list in itself": with_reach("${xacro.load_yaml('itself.yaml')}"),
    "a YAML nested deep": with_reach("${xacro.load_yaml('deep.yaml')}"),
    "a YAML elsewhere": with_reach("${xacro.load_yaml('/proc/self/environ')}"),
    "an include of itself": with_reach("0.1", '<xacro:include filename="arm.xacro"/>'),
}


@pytest.mark.parametrize("name", sweep(HOSTILE, set(HOSTILE) - {"a YAML nested deep", "an include of itself"}))
def test_a_xacro_runs_nothing_and_takes_no_machine_for_itself(arm: Path, name: str) -> None:
    folder = arm.parent
    (folder / "none.xacro").write_text(HEAD + "</robot>")
    (folder / "object.yaml").write_text("x: !!python/object/apply:os.system ['touch ran']\n")
    (folder / "unit.yaml").write_text('x: !degrees "().__class__.__mro__"\n')
    levels = (f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 15))
    (folder / "bomb.yaml").write_text("a0: &a0 [x]\n" + "".join(levels))
    (folder / "itself.yaml").write_text("&a [*a]\n")
    (folder / "deep.yaml").write_text("[" * 20_000)
    before = sorted(path.name for path in folder.iterdir())
    arm.write_text(HOSTILE[name])
    with pytest.raises(RobotFileError) as caught:
        read_robot(arm, ReadOptions(xacro=Xacro()))
    assert str(caught.value).startswith(f"{arm}: line ")
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.thorough
def test_macros_that_double_are_given_up(arm: Path) -> None:
    macros = "".join(f'<xacro:macro name="m{k}"><xacro:m{k - 1}/><xacro:m{k - 1}/></xacro:macro>' for k in range(1, 40))
    arm.write_text(f'{HEAD}<xacro:macro name="m0"><link name="x"/></xacro:macro>{macros}<xacro:m39/></robot>')
    with pytest.raises(RobotFileError, match=r"makes more than 100000 elements|not done after"):
        read_robot(arm, ReadOptions(xacro=Xacro()))


# What stock descriptions do (UR, Franka, xArm, KUKA, ABB, Kinova): tables of limits in degrees, names behind dots,
# namespaces, blocks, defaults taken from outside, scopes, conditions, dynamic calls, attributes that are made.
STOCK = (
    HEAD
    + """  <xacro:arg name="kind" default="big"/>
  <xacro:arg name="prefix" default=""/>
  <xacro:property name="limits" value="${xacro.load_yaml('limits.yaml')}"/>
  <xacro:property name="start" value="${dict(joint_1=0.5, joint_2=-1.0)}" lazy_eval="false"/>
  <xacro:property name="prefix" value="$(arg prefix)"/>
  <xacro:include filename="parts/tools.xacro" ns="tools"/>
  <xacro:macro name="data" params="which">
    <xacro:property name="sec" value="${limits['joints'][which]}"/>
    <xacro:property name="low" value="${sec.min}" scope="parent"/>
    <xacro:property name="high" value="${sec.max if sec.max else pi}" scope="parent"/>
  </xacro:macro>
  <xacro:property name="blocks">
    <origin xyz="0 0 ${limits.height * 2}" rpy="${-pi / 2} 0 ${radians(30)}"/></xacro:property>
  <xacro:macro name="stage" params="n parent prefix:=^|'' scale:=${1 + 1} *first **rest">
    <xacro:data which="joint_${n}"/>
    <link name="${prefix}link${n}"><xacro:insert_block name="rest"/></link>
    <joint name="${prefix}joint${n}" type="revolute">
      <parent link="${parent}"/><child link="${prefix}link${n}"/>
      <xacro:insert_block name="first"/>
      <axis xyz="0 ${n % 2} ${1 - n % 2}"/>
      <limit lower="${low}" upper="${high}" effort="${'%.1f' % (scale * 10)}" velocity="${tools.speed}"/>
    </joint>
    <xacro:unless value="${n == 1}">
      <note text="${start['joint_' + str(n)]} ${prefix.startswith('x')}"/>
    </xacro:unless>
  </xacro:macro>
  <link name="base"/>
  <xacro:stage n="1" parent="base">
    <xacro:insert_block name="blocks"/><rest><a/><b v="${xacro.warning('said')}"/></rest>
  </xacro:stage>
  <xacro:call macro="stage" n="2" parent="${prefix}link1" prefix="x_">
    <origin xyz="${' '.join([str(v) for v in limits.offset])}"/><rest/>
  </xacro:call>
  <xacro:if value="$(eval kind == 'big' and 2 > 1)"><xacro:tools.tool name="grip"/></xacro:if>
  <xacro:if value="${python.any([k == 'none' for k in ['big', 'small']])}"><xacro:no/></xacro:if>
  <xacro:element xacro:name="made_${prefix}"><xacro:attribute name="v" value="1 ${1e-5}"/></xacro:element>
</robot>
"""
)
TOOLS = (
    HEAD
    + """  <xacro:property name="speed" value="${2 * pi}"/>
  <xacro:macro name="tool" params="name"><link name="${name}_${int('3') // 2}"/></xacro:macro>
</robot>
"""
)
LIMITS = """height: 0.25
offset: [0.1, 0, -0.02]
joints:
  joint_1: {min: !degrees -180.0, max: !degrees 180.0, since: 2020-01-02}
  joint_2: &two {min: -1.5, max: null}
  joint_3: *two
"""
ORACLE = """
import json, sys, xacrodoc
print(json.dumps(xacrodoc.XacroDoc.from_file(sys.argv[1], walk_up=False, subargs=json.loads(sys.argv[2])).dom.toxml()))
"""


@pytest.mark.parametrize("args", [{}, {"kind": "small", "prefix": "x_"}, {"prefix": "left_"}])
def test_what_stock_descriptions_do_is_expanded_as_the_library_does(
    arm: Path, tmp_path: Path, args: dict[str, str]
) -> None:
    (arm.parent / "parts" / "tools.xacro").write_text(TOOLS)
    (arm.parent / "limits.yaml").write_text(LIMITS)
    arm.write_text(STOCK)
    said = subprocess.run(
        [sys.executable, "-c", ORACLE, str(arm), json.dumps(args)],
        cwd=arm.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    theirs = parse_xml(arm, json.loads(said.stdout.splitlines()[-1]).encode()).root
    mine = module.expanded_xacro(arm, Xacro(args)).root

    def contents(element: Element) -> object:
        return element.tag, dict(element.attributes), [contents(child) for child in element.children]

    assert contents(mine) == contents(theirs)
    assert len(mine.children) >= 6
