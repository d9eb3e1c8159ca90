"""Robots' files as people have them: tables in JSON, grippers, leftovers of macros and merges, what a form loses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib import load_robot, save_robot
from calib.errors import CalibError
from calib.robot_formats.robot_file import read_arm, tips_of
from calib.robot_formats.urdf.meshes import link_meshes
from tests.support.chains import joint, link, urdf_of
from tests.support.commands import printed
from tests.support.standard_dh import joints_at_random, standard, tips

ROWS = np.array([[0.0, 0.0, 150.0, np.pi / 2], [0.0, -240.0, 0.0, 0.0], [-np.pi / 2, 30.0, 100.0, -np.pi / 2]])


@pytest.mark.parametrize("form", ["offsets", "symbols", "by name"])
def test_a_table_of_theta_d_a_alpha_as_json(tmp_path: Path, form: str) -> None:
    pi = {0.0: "0", np.pi / 2: "pi/2", -np.pi / 2: "-pi/2"}
    each = [
        {"joint_id": f"J{k}", "a": a / 1e3, "alpha": alpha, "d": d / 1e3, "theta_offset": theta}
        if form == "offsets"
        else {"theta": f"q{k}" + (f" - {pi[-theta]}" if theta else ""), "d_mm": d, "a_mm": a, "alpha": pi[alpha]}
        for k, (theta, a, d, alpha) in enumerate(ROWS.tolist(), 1)
    ]
    told: object = {"units": {"length": "m", "angle": "rad"}, "dh_convention": "standard", "joints": each}
    if form != "offsets":
        told = {"dh": each if form == "symbols" else {f"joint{k}": row for k, row in enumerate(each)}}
    path = tmp_path / "dh.json"
    path.write_text(json.dumps(told))
    robot = load_robot(path, convention=None if form == "offsets" else "standard")
    q = joints_at_random(5, 3)
    np.testing.assert_allclose(tips(robot, q), [standard(ROWS, one) for one in q], atol=1e-9)
    path.write_text(json.dumps({"robot": [1, 2]}))
    with pytest.raises(CalibError, match="found robot; a list with a, alpha, d, theta of each joint"):
        load_robot(path)


def arm_with_jaw(tmp_path: Path, *, fingers: int = 1, mesh: str = "") -> Path:
    names = ["base", "upper", "hand", *(f"finger_{k}" for k in range(fingers))]
    links = "".join(map(link, names)).replace('<link name="hand"/>', f'<link name="hand">{mesh}</link>')
    joints = joint("turn", "base", "upper", xyz="0 0 0.2") + joint("roll", "upper", "hand", xyz="0.3 0 0")
    joints += "".join(joint(f"jaw_{k}", "hand", f"finger_{k}", xyz="0 0 0.1") for k in range(fingers))
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_of(links, joints))
    return path


def test_a_grippers_jaw_is_no_joint_of_the_arm_unless_it_is_asked_for(tmp_path: Path) -> None:
    path = arm_with_jaw(tmp_path)
    assert load_robot(path).n_joints == 2
    assert "the arm ends at hand, before the jaw of its gripper; --tip finger_0 takes the jaw along" in printed(
        "convert", path, tmp_path / "arm.toml"
    )
    assert load_robot(path, tip="finger_0").n_joints == 3
    assert tips_of(path) == ("hand", "finger_0")
    with pytest.raises(CalibError, match="choose one with --tip: hand, finger_0"):
        load_robot(arm_with_jaw(tmp_path, fingers=2))


def test_meshes_named_by_file_urls_are_found(tmp_path: Path) -> None:
    (tmp_path / "a mesh.stl").write_bytes(b"solid")
    named = f'<visual><geometry><mesh filename="file://{tmp_path}/a%20mesh.stl"/></geometry></visual>'
    arm = read_arm(arm_with_jaw(tmp_path, mesh=named), tip="hand")
    assert [one.path.name for files in link_meshes(arm, {}).of_joint for one in files] == ["a mesh.stl"]
    assert not any(link_meshes(arm, None).of_joint)  # of an upload no file of this machine is read


def test_leftovers_of_macros_and_blocks_without_kinematics_are_passed_over(tmp_path: Path) -> None:
    path = arm_with_jaw(tmp_path)
    text = path.read_text()
    opened = text.index(">", text.index("<robot")) + 1
    path.write_text(
        text[: opened - 1] + ' xmlns:xacro="http://x"><xacro:property name="pi" value="3.14"/>' + text[opened:]
    )
    assert load_robot(path).n_joints == 2
    block = "kinematics:\n  shoulder:\n    x: 0\n    y: 0\n    z: 0.1\n    roll: 0\n    pitch: 0\n    yaw: 0\n"
    origins = tmp_path / "arm.yaml"
    origins.write_text(f"{block}  com:\n    x: 1\n    y: 2\n    z: 3\nlimits: [1, 2]\nnames:\n  - a\n")
    assert load_robot(origins).n_joints == 1


def test_a_merge_conflict_is_called_that(tmp_path: Path) -> None:
    path = arm_with_jaw(tmp_path)
    text = path.read_text()
    at = text.index("<joint")
    path.write_text(f"{text[:at]}\n<<<<<<< HEAD\n{text[at:]}\n=======\n>>>>>>> other\n")
    with pytest.raises(CalibError, match="a merge conflict that is not settled"):
        load_robot(path)


def test_what_a_kinematics_file_loses_of_the_tip_is_said(tmp_path: Path) -> None:
    notes = save_robot("rb5", tmp_path / "arm.yaml")
    assert any("the tip, " in note and "is lost; .toml keeps it" in note for note in notes)
