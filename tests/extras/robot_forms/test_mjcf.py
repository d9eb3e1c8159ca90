"""MuJoCo models: what MuJoCo makes of them, and untrusted ones, which lead to no file outside their folder."""

from __future__ import annotations

import resource
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.effects.gravity import GravityLoads
from calib.extras.robot_forms import mjcf
from calib.kinematics.chain import nominal_chain
from calib.robot_formats.chain.serial_chain import RobotFileError, SerialChain
from calib.robot_formats.robot_file import ReadOptions, read_robot
from inspector.cli.parser import main
from tests.support.robot_texts import MJCF

mujoco = pytest.importorskip("mujoco")

JOINT = '<joint name="j{0}" axis="0 {0} 1"/><inertial pos="0 0 0.1" mass="{0}" diaginertia="1 1 1"/>'
HAND = '<body name="hand" pos="0 0 1">' + JOINT.format(2) + "</body>"


def model(inside: str = HAND, before: str = "", after: str = "") -> str:
    """MJCF of an arm with two joints."""
    arm = f'<body name="arm" pos="1 2 3">{JOINT.format(1)}{inside}</body>'
    return f"<mujoco>{before}<worldbody>{arm}</worldbody>{after}</mujoco>"


def chain(path: Path) -> SerialChain:
    read = read_robot(path, ReadOptions(tip="hand"))
    assert read.chain is not None
    return read.chain


def cube(size: float) -> bytes:
    """Binary STL of a tetrahedron."""
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32)
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    body = b"".join(struct.pack("<3f", 0, 0, 0) + corners[list(f)].tobytes() + b"\0\0" for f in faces)
    return b"\0" * 80 + struct.pack("<I", len(faces)) + body


@pytest.mark.slow
def test_a_mujoco_model_is_what_mujoco_makes_of_it(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    robot = read_robot(path, ReadOptions(tip="tcp")).robot
    assert [(j.name, j.type) for j in robot.joints] == [
        ("j1", "revolute"),
        ("j2", "revolute"),
        ("j3", "prismatic"),
        ("j4", "revolute"),
    ]
    assert robot.joints[0].max == pytest.approx(np.pi / 2)
    assert robot.joints[2].max == pytest.approx(400.0)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q = np.random.default_rng(0).uniform(-1, 1, (50, 4))
    chain = nominal_chain(robot, q * [1, 1, 1e3, 1])
    torques = GravityLoads(robot, chain, None).joint_torques
    for values, mine, torque in zip(q, chain.base_T_frame[:, -1], torques, strict=True):
        data.qpos[:] = values
        mujoco.mj_forward(model, data)
        assert mine[:3, 3] == pytest.approx(1e3 * data.site("tcp").xpos, abs=1e-9)
        assert mine[:3, :3] == pytest.approx(data.site("tcp").xmat.reshape(3, 3), abs=1e-12)
        assert torque == pytest.approx(-data.qfrc_bias, abs=1e-9)
    assert read_robot(path).chain is not None
    part = read_robot(path, ReadOptions(base="one")).robot
    assert [j.name for j in part.joints] == ["j3", "j4"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('type="slide" axis="0 1 0" range="-0.2 0.4"', 'type="ball"', "'j3' is a ball or free joint"),
        ("</mujoco>", "", "not valid XML"),
        ('axis="0 1 0"/>', 'axis="0 0 0"/>', "MuJoCo refuses it"),
        (
            'pos="0 0 0.05" ref',
            'pos="0 -1e308 0.05" ref',
            r"a part is more than 1e\+06 m away; lengths are metres",
        ),
        (
            '<site name="tcp"',
            '<body name="fork"/><body name="other"/><site name="tcp"',
            "several tips; choose one with --tip",
        ),
    ],
)
def test_a_mujoco_model_that_cannot_be_used_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.replace(old, new, 1))
    with pytest.raises(RobotFileError, match=said) as caught:
        read_robot(path)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_meshes_weigh_what_mujoco_says(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    (tmp_path / "parts" / "deep").mkdir(parents=True)
    (tmp_path / "parts" / "deep" / "a.stl").write_bytes(cube(0.3))
    path.write_text(
        model(
            '<body name="hand"><joint name="k"/><geom type="mesh" mesh="a"/></body>',
            before='<compiler meshdir="parts"/><asset><mesh file="deep/a.stl"/></asset>',
        )
    )
    theirs = mujoco.MjModel.from_xml_path(str(path))
    mine = chain(path)
    assert mine.joints[1].mass_kg == pytest.approx(float(theirs.body("hand").mass[0]), rel=1e-12)
    assert mine.joints[1].com_mm == pytest.approx(1e3 * theirs.body("hand").ipos, abs=1e-9)


def in_assets(part: str, inside: str = HAND) -> str:
    return model(inside, before=f"<asset>{part}</asset>")


REFUSED = {
    "an include": (model(after='<include file="arm.xml"/>'), "found <include>"),
    "a folder of meshes elsewhere": (
        model(before='<compiler meshdir="../x/.."/>'),
        "names '../x/..', which is not below",
    ),
    "a count of parts": (model(after="<worldbody><replicate count='100000000'/></worldbody>"), "found <replicate>"),
    "a size of memory": (model(after='<size memory="1000G"/>'), "found <size>"),
    "a plugin": (model(after='<extension><plugin plugin="x"/></extension>'), "found <extension>"),
    "another model": (in_assets('<model name="x" file="arm.xml"/>'), "found <model>"),
    "an attached model": (model(HAND + '<attach model="x" body="b" prefix="c"/>'), "found <attach>"),
    "a cable": (model(HAND + '<composite type="cable" count="99999999"/>'), "found <composite>"),
    "an absolute mesh": (in_assets('<mesh file="/etc/passwd"/>'), "names '/etc/passwd', which is not below"),
    "a texture from elsewhere": (in_assets('<texture name="t" type="2d" file="../t.png"/>'), "which is not below"),
    "a link out of the folder": (in_assets('<mesh file="zero.stl"/>'), "zero.stl', which is not below"),
    "a height field of any size": (
        in_assets(
            '<hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/>', HAND + '<geom type="hfield" hfield="h"/>'
        ),
        "MuJoCo",
    ),
    "a model nested deep": (model("<body>" * 190 + "</body>" * 190), r"too many|levels|no joint|--tip|hand"),
    "a mesh that is none": (in_assets('<mesh file="none.stl"/>'), "MuJoCo"),
    "a mesh that makes itself": (
        in_assets('<mesh name="s" builtin="sphere" params="14"/>', HAND + '<geom type="mesh" mesh="s"/>'),
        "MuJoCo|more than",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_no_model_leads_out_of_its_folder_or_takes_the_machine_for_itself(tmp_path: Path, name: str) -> None:
    text, said = REFUSED[name]
    path = tmp_path / "arm.xml"
    path.write_text(text)
    (tmp_path / "none.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 2**31 - 1) + b"x" * 500)
    (tmp_path / "zero.stl").symlink_to("/dev/zero")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RobotFileError, match=said) as caught:
        read_robot(path, ReadOptions(tip="hand"))
    assert "\n" not in str(caught.value)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


@pytest.mark.slow
def test_a_model_that_ends_mujoco_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    monkeypatch.setattr(mjcf, "_LIMITS", replace(mjcf._LIMITS, memory_bytes=0))
    assert main(["convert", str(path), str(tmp_path / "out.toml")]) == 2
    said = capsys.readouterr().err
    assert "MuJoCo cannot read it" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out.toml").exists()
