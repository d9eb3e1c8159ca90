"""Writing of URDF changes origins only, and the file read again is the calibrated arm."""

from __future__ import annotations

import difflib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, robot_to_toml
from calib.effects.gravity import GravityLoads
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot
from calib.robot_formats.calibrated_file import calibrated_urdf
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.chain.serial_chain import chain_frames
from calib.robot_formats.robot_file import ReadOptions, read_robot
from calib.robot_formats.urdf.text import plain_urdf
from tests.support.chains import chains, joint, link, shoulder_arm, urdf_of

AB = link("a") + link("b") + link("c")


def tips(robot: Robot, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).uniform(-2, 2, (20, robot.n_joints)) * np.where(robot.is_revolute, 1.0, 200.0)
    return nominal_chain(robot, q).base_T_frame[:, -1]


@pytest.fixture
def template(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(shoulder_arm())
    return path


def through_toml(robot: Robot, tmp_path: Path) -> Robot:
    path = tmp_path / "robot.toml"
    path.write_text(robot_to_toml(robot))
    return load_robot_toml(path)


def test_nothing_calibrated_is_a_text_diff_of_nothing(template: Path, tmp_path: Path) -> None:
    robot = through_toml(read_robot(template, ReadOptions(tip="tool0")).robot, tmp_path)
    out = calibrated_urdf(template, robot, comment="by nobody")
    assert out.content == template.read_bytes()
    assert out.changed == ()


def test_only_origins_change_and_the_file_reads_as_the_calibrated_arm(template: Path, tmp_path: Path) -> None:
    nominal = read_robot(template, ReadOptions(tip="tool0")).robot
    change = np.random.default_rng(0).normal(0, 1, nominal.table.shape) * [1.0, 0.005, 1.0, 0.005, 0.005]
    calibrated = nominal.with_table(nominal.table + change)
    out = calibrated_urdf(template, through_toml(calibrated, tmp_path), nominal, comment="calibrated -- today")
    assert out.changed == ("pan", "lift", "elbow", "slide", "roll", "tool_fixed")
    again = tmp_path / "calibrated.urdf"
    again.write_bytes(out.content)
    found = read_robot(again, ReadOptions(tip="tool0")).robot
    assert np.abs(tips(found) - tips(calibrated))[:, :3, 3].max() < 1e-9
    before, after = template.read_text().splitlines(), out.content.decode().splitlines()
    changed = [line[2:] for line in difflib.ndiff(before, after) if line[0] in "+-"]
    assert all("<origin" in line or "<!-- calibrated" in line for line in changed)


def test_one_joints_zero_changes_one_line(template: Path) -> None:
    nominal = read_robot(template, ReadOptions(tip="tool0")).robot
    table = nominal.table
    table[2, 3] += np.radians(0.2)
    out = calibrated_urdf(template, nominal.with_table(table), nominal)
    assert out.changed == ("elbow",)


@pytest.mark.parametrize(
    ("origin", "wanted"),
    [
        ("", '>\n    <origin xyz="0.001 0.0 0.5"/>'),
        ('<origin rpy="0 0 0"/>', '<origin xyz="0.001 0.0 0.5" rpy="0 0 0"/>'),
        (
            "<origin\n  rpy='0 0 0'\n  xyz = '0 0 0.4'></origin>",
            "<origin\n  rpy='0 0 0'\n  xyz = \"0.001 0.0 0.5\"></origin>",
        ),
    ],
)
def test_origins_in_any_dress(tmp_path: Path, origin: str, wanted: str) -> None:
    tool = joint("t", "b", "c", "@", type="fixed")
    tool = tool.replace('    <origin xyz="@" rpy="0 0 0"/>\n', f"    {origin}" if origin else "")
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_of(AB + "<!-- <joint> in ä comment -->\n", joint("j", "a", "b") + tool))
    nominal = read_robot(path).robot
    table = nominal.table
    table[-1, 0], table[-1, 2] = 1.0, 500.0
    out = calibrated_urdf(path, nominal.with_table(table), nominal).content.decode()
    assert wanted in out
    assert "<!-- <joint> in ä comment -->" in out


def test_a_tip_that_no_fixed_joint_holds_is_told(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_of(link("a") + link("b"), joint("j", "a", "b")))
    nominal = read_robot(path).robot
    table = nominal.table
    table[-1, 2] = 5.0
    out = calibrated_urdf(path, nominal.with_table(table), nominal)
    assert out.content == path.read_bytes()
    assert "no fixed joint holds link b" in out.summary


@pytest.mark.slow
def test_any_chain_goes_through_a_plain_urdf(tmp_path: Path) -> None:
    for chain, q in chains(60, seed=8):
        found = read_back(tmp_path / "plain.urdf", plain_urdf(chain))
        mine = nominal_chain(found, q).base_T_frame[:, -1]
        assert np.abs(mine - chain_frames(chain, q)[:, -1]).max() < 1e-9


@pytest.mark.parametrize("gravity", [(0.0, 9.81, 0.0), (3.0, -4.0, 5.0), (0.0, 0.0, 9.81)])
def test_a_base_that_leans_hangs_on_a_world(tmp_path: Path, gravity: tuple[float, float, float]) -> None:
    size = 9.81 / float(np.linalg.norm(gravity))
    x, y, z = (size * v for v in gravity)
    robot = replace(builtin_robot("rb5"), gravity_m_s2=(x, y, z))
    path = tmp_path / "plain.urdf"
    path.write_text(plain_urdf(chain_of(robot)))
    q = np.random.default_rng(0).uniform(-2, 2, (5, 6))
    whole, part = read_robot(path).robot, read_robot(path, ReadOptions(base="base_link")).robot
    assert part.gravity_m_s2 == pytest.approx(robot.gravity_m_s2, abs=1e-12)
    loads = [GravityLoads(r, nominal_chain(r, q), None).joint_torques for r in (robot, whole, part)]
    assert loads[1] == pytest.approx(loads[0], abs=1e-9)
    assert loads[2] == pytest.approx(loads[0], abs=1e-9)


def read_back(path: Path, text: str) -> Robot:
    path.write_text(text)
    return read_robot(path).robot
