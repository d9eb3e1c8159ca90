"""Conversion of any serial chain to a five-parameter table and back gives the same arm up to rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.gravity import GravityLoads
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import FixedFrame, Robot
from calib.robot_formats.chain.calibrated_origins import with_calibration
from calib.robot_formats.chain.five_parameters import chain_of, robot_of
from calib.robot_formats.chain.serial_chain import ChainJoint, RobotFileError, SerialChain, chain_frames
from tests.support.chains import chains, transform


def tip_of(robot: Robot, q: np.ndarray) -> np.ndarray:
    return nominal_chain(robot, q).base_T_frame[:, -1]


def assert_same(one: np.ndarray, other: np.ndarray) -> None:
    assert np.abs(one[:, :3, 3] - other[:, :3, 3]).max() < 1e-9  # mm
    assert np.abs(one[:, :3, :3] - other[:, :3, :3]).max() < 1e-12


COUNTS = [60, pytest.param(300, marks=pytest.mark.thorough)]


@pytest.mark.parametrize("count", COUNTS)
def test_any_chain_becomes_a_table_that_reaches_the_same_places(count: int) -> None:
    longest = []
    for chain, q in chains(count):
        robot = robot_of(chain)
        assert_same(tip_of(robot, q), chain_frames(chain, q)[:, -1])
        assert np.abs(robot.table[:, 4][:-1]).max() < np.pi / 4 + 1e-9  # beta
        assert np.abs(robot.table[:, 3][:-1]).max() <= np.pi / 2 + 1e-9  # theta
        longest.append(np.abs(robot.table[:, [0, 2]]).max())
    assert max(longest) < 2500.0  # of chains whose lengths are up to 693 mm


@pytest.mark.parametrize("count", COUNTS)
def test_any_table_becomes_a_chain_and_a_table_again(count: int) -> None:
    rng = np.random.default_rng(1)
    for chain, q in chains(count, seed=1):
        robot = robot_of(chain)
        table = robot.table + rng.normal(0, 1, robot.table.shape) * [100.0, 1.0, 100.0, 1.0, 1.0]
        any_robot = replace(robot.with_table(table), base=FixedFrame((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)))
        again = chain_of(any_robot)
        assert_same(chain_frames(again, q)[:, -1], tip_of(any_robot, q))
        assert_same(tip_of(robot_of(again), q), tip_of(any_robot, q))


def test_masses_hang_where_they_hung() -> None:
    for chain, q in chains(30, seed=2):
        robot = robot_of(chain)
        frames = nominal_chain(robot, q)
        places = chain_frames(chain, q)
        for k, (joint, of_chain) in enumerate(zip(robot.joints, chain.joints, strict=True)):
            assert joint.mass_kg == of_chain.mass_kg
            mine = frames.base_T_frame[:, k + 1] @ [*joint.com_mm, 1.0]  # type: ignore[misc]
            theirs = places[:, k] @ [*of_chain.com_mm, 1.0]  # type: ignore[misc]
            assert mine == pytest.approx(theirs, abs=1e-9)
        again = robot_of(chain_of(robot))
        torques = [GravityLoads(r, nominal_chain(r, q), None).joint_torques for r in (robot, again)]
        assert torques[0] == pytest.approx(torques[1], abs=1e-9)


def test_an_upright_arm_with_square_axes_gets_the_table_that_one_writes_by_hand() -> None:
    """The table of the UR10, whose URDF has joints about y and offsets along the axes, is the usual one."""
    square, none = np.pi / 2, (0.0, 0.0, 0.0)
    places = [
        ((0, 0, 127.3), none, (0, 0, 1)),
        ((0, 220.941, 0), (0, square, 0), (0, 1, 0)),
        ((0, -171.9, 612.0), none, (0, 1, 0)),
        ((0, 0, 572.3), (0, square, 0), (0, 1, 0)),
        ((0, 114.9, 0), none, (0, 0, 1)),
        ((0, 0, 115.7), none, (0, 1, 0)),
    ]
    joints = tuple(ChainJoint(f"J{k}", transform(xyz, rpy), axis) for k, (xyz, rpy, axis) in enumerate(places, 1))
    robot = robot_of(SerialChain("UR10", joints, transform((0, 92.2, 0), (0, 0, square))))
    assert robot.base == FixedFrame()
    a, alpha, d, theta, beta = robot.table.T
    assert np.abs(a) == pytest.approx([0, 612.0, 572.3, 0, 0, 0, 0], abs=1e-9)
    assert np.abs(alpha[:5]) == pytest.approx([square, 0, 0, square, square], abs=1e-12)
    assert d[0] == pytest.approx(127.3)
    assert abs(d[1] + d[2] + d[3]) == pytest.approx(163.941)
    assert beta[:6] == pytest.approx(np.zeros(6), abs=1e-12)
    assert np.all(np.abs(theta[:6]) < square + 1e-9)


def test_frames_without_a_common_normal_stand_near_the_points_that_are_given() -> None:
    for chain, q in chains(30, seed=3):
        near = chain.at_zero[1:-1, :3, 3] + 5.0
        robot = robot_of(chain, list(near))
        frames = nominal_chain(robot, np.zeros_like(q)).base_T_frame[0]
        off_mm = np.linalg.norm(frames[1:-2, :3, 3] - near, axis=1)
        steep = np.linalg.norm(np.cross(frames[:-3, :3, 2], frames[1:-2, :3, 2]), axis=1) > np.sqrt(0.5)
        assert off_mm[~steep].max(initial=0.0) < np.sqrt(75) + 1e-9
        assert np.abs(robot.table[:-2, 4][steep]).max(initial=0.0) < 1e-9
        assert_same(tip_of(robot, q), chain_frames(chain, q)[:, -1])


def test_calibrated_origins_reach_what_the_calibrated_table_reaches() -> None:
    rng = np.random.default_rng(5)
    for chain, q in chains(40, seed=4):
        nominal = robot_of(chain)
        change = rng.normal(0, 1, nominal.table.shape) * [1.0, 0.01, 1.0, 0.01, 0.01]
        calibrated = nominal.with_table(nominal.table + change)
        found = with_calibration(chain, nominal, calibrated)
        assert found.tip_known
        assert_same(chain_frames(found.chain, q)[:, -1], tip_of(calibrated, q))


def test_another_arm_is_refused_by_its_joint() -> None:
    nominal = builtin_robot("rb5")
    table = nominal.table
    table[1, 0] += 3.0
    other = nominal.with_table(table)
    with pytest.raises(RobotFileError, match=r"axis of joint 3 .* is 3 mm"):
        with_calibration(chain_of(other), nominal, nominal)
    with pytest.raises(RobotFileError, match="has 6 joints"):
        with_calibration(chain_of(other), builtin_robot("panda"), nominal)
