"""robot.toml: round trip, and a one-line error with the place for each mistake."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml, refuse_beyond, robot_to_toml
from calib.errors import DatasetError
from calib.frames import apply
from calib.kinematics.chain import forward, target_points
from calib.kinematics.robot import Robot
from calib.options import BUILTIN_ROBOTS
from tests.support.arms import jang_arm, perturbed

GOOD = """
name = "two"
serial = "X-17"

[[joints]]
a_mm = 100.0
alpha_deg = 90.0
d_mm = 10.0
theta_deg = 0.0
colour = "red"

[[joints]]
type = "prismatic"
a_mm = 200.0
alpha_deg = 0.0
d_mm = 0.0
theta_deg = 0.0
min_mm = -50.0
max_mm = 50.0

[tool]
a_mm = 0.0
alpha_deg = 0.0
d_mm = 50.0
theta_deg = 0.0
maker = "us"

[[targets]]
name = "smr2"
xyz_mm = [1.0, 2.0, 3.0]
"""


def written(robot: Robot, path: Path) -> Robot:
    path.write_text(robot_to_toml(robot), encoding="utf-8")
    return load_robot_toml(path)


def test_a_size_that_is_no_number_is_beyond_every_bound(tmp_path: Path) -> None:
    """Other robot formats with finite numbers can give sizes that are not finite."""
    robot = jang_arm()
    refuse_beyond(robot, tmp_path)
    odd = robot.with_table(np.where(np.arange(robot.table.size).reshape(robot.table.shape) == 7, np.nan, robot.table))
    with pytest.raises(DatasetError, match=r"\[\[joints\]\] 2\.d_mm: found nan"):
        refuse_beyond(odd, tmp_path)


def test_round_trip_loses_nothing_not_even_keys_it_does_not_know(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(GOOD)
    robot = load_robot_toml(path)
    assert robot.joints[1].max == 50.0
    assert robot.extra == {"serial": "X-17"}
    assert robot.joints[0].extra == {"colour": "red"}
    assert robot.tool.extra == {"maker": "us"}
    assert written(robot, tmp_path / "again.toml") == robot


@pytest.mark.parametrize("name", BUILTIN_ROBOTS)
def test_built_in_robots_read_and_survive_writing(name: str, tmp_path: Path) -> None:
    robot = builtin_robot(name)
    assert all(joint.mass_kg and joint.com_mm for joint in robot.joints)
    assert written(robot, tmp_path / "robot.toml") == robot


def test_the_built_in_rb5_is_jangs_table_2() -> None:
    np.testing.assert_allclose(builtin_robot("rb5").table, jang_arm().table, atol=1e-12)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
def test_a_calibrated_table_comes_back_to_the_last_digits(seed: int) -> None:
    robot = perturbed(builtin_robot("panda"), np.random.default_rng(seed))
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        again = written(robot, Path(folder) / "robot.toml")
    np.testing.assert_allclose(again.table, robot.table, rtol=1e-14, atol=1e-16)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("a_mm = 100.0\n", "", "[[joints]] 1.a_mm: the key is missing"),
        ("a_mm = 100.0", 'a_mm = "long"', "[[joints]] 1.a_mm: found 'long'; a finite number is needed"),
        ("a_mm = 100.0", "a_mm = nan", "a finite number is needed"),
        ('type = "prismatic"', 'type = "ball"', "expected 'revolute' or 'prismatic'"),
        ("max_mm = 50.0", "max_mm = -60.0", "not above min_mm"),
        ("[tool]", "[tooth]", "found no [tool]"),
        ("xyz_mm = [1.0, 2.0, 3.0]", "xyz_mm = [1.0, 2.0]", "three finite numbers"),
        ('name = "smr2"', 'name = "jig"\njoint = 1', "the tool's measured point is on the last link"),
        ("a_mm = 100.0", "a_mm = = 1", "not valid TOML"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "robot.toml"
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(DatasetError) as caught:
        load_robot_toml(path)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


ROW = "[tool]\na_mm = 0.0\nalpha_deg = 0.0\nd_mm = 50.0\ntheta_deg = 0.0\n"


@pytest.mark.parametrize(
    "xyz_mm",
    [
        (12.0, -40.0, 80.0),
        (-12.0, -40.0, 80.0),
        (-12.0, 40.0, -8.0),
        (0.0, -40.0, 80.0),
        (-30.0, 0.0, 80.0),
        (0.0, 0.0, 0.0),
    ],
)
def test_a_tool_given_as_a_point_is_there_at_every_pose(tmp_path: Path, xyz_mm: tuple[float, float, float]) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(GOOD)
    plain = load_robot_toml(path)
    path.write_text(GOOD.replace(ROW, f"[tool]\nxyz_mm = {list(xyz_mm)}\n"))
    robot = load_robot_toml(path)
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (20, 2))
    flange = forward(plain.table, q, plain.is_revolute).base_T_flange
    np.testing.assert_allclose(target_points(robot, q), apply(flange, np.array(xyz_mm)), atol=1e-12)
    assert abs(robot.tool.theta_rad) <= np.pi / 2
    if xyz_mm[1] == 0.0:
        assert (robot.tool.a_mm, robot.tool.theta_rad, robot.tool.d_mm) == (xyz_mm[0], 0.0, xyz_mm[2])
    assert dict(robot.tool.extra) == {"maker": "us"}
    assert written(robot, path).tool.row == pytest.approx(robot.tool.row, abs=1e-12)


def test_a_tool_is_a_point_or_a_row(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(GOOD.replace("[tool]\n", "[tool]\nxyz_mm = [1.0, 2.0, 3.0]\n"))
    with pytest.raises(DatasetError, match=r"\[tool\]\.a_mm: found beside xyz_mm; give the point or the row"):
        load_robot_toml(path)


def test_metres_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(GOOD.replace("100.0", "0.1").replace("200.0", "0.2").replace("d_mm = 10.0", "d_mm = 0.01")
                    .replace("d_mm = 50.0", "d_mm = 0.05"))  # fmt: skip
    with pytest.raises(DatasetError, match="looks like metres"):
        load_robot_toml(path)


def test_an_unknown_built_in_name_lists_what_there_is() -> None:
    with pytest.raises(DatasetError, match="there are rb5, panda"):
        builtin_robot("kuka")


def test_no_joint_and_no_file(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such file"):
        load_robot_toml(tmp_path / "robot.toml")
    (tmp_path / "robot.toml").write_text("name = 'x'\n")
    with pytest.raises(DatasetError, match=r"found no \[\[joints\]\]"):
        load_robot_toml(tmp_path / "robot.toml")
