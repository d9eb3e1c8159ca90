"""Tool points of tables in the nominal arm's frame, tolerances and directions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.link_errors import LinkErrors
from calib.fitting.tool_point import (
    free_directions,
    tip_turn_rad,
    tolerance_covariance,
    tool_point_in_nominal,
)
from calib.kinematics.chain import forward, target_points
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import (
    ending_at_tool_point,
    tip_T_last,
    tool_point,
    tool_point_of,
    with_own_tool_point,
    with_tool_point,
)
from tests.support.arms import elementary_points, jang_arm, perturbed, random_arm


def arm(a_mm: float = 0.0, theta_rad: float = 0.0) -> Robot:
    robot = jang_arm()
    return replace(robot, tool=replace(robot.tool, a_mm=a_mm, theta_rad=theta_rad))


@pytest.mark.parametrize("robot", [arm(), arm(60.0, 0.4), arm(-30.0, -2.0)])
def test_any_point_is_reached_and_the_row_turns_by_a_quarter_turn_at_most(robot: Robot) -> None:
    rng = np.random.default_rng(0)
    for point_mm in rng.normal(size=(50, 3)) * 150.0:
        moved = with_tool_point(robot, point_mm)
        np.testing.assert_allclose(tool_point(moved.table), point_mm, atol=1e-9)
        assert abs(moved.tool.theta_rad - robot.tool.theta_rad) <= np.pi / 2 + 1e-12
        np.testing.assert_array_equal(moved.table[:-1], robot.table[:-1])


def test_on_the_axis_theta_stays() -> None:
    assert with_tool_point(arm(60.0, 0.4), np.array([0.0, 0.0, 90.0])).tool.theta_rad == 0.4
    near_mm = np.array([1.0, -2.0, 90.0])
    np.testing.assert_allclose(tool_point(with_tool_point(arm(60.0, 0.4), near_mm).table), near_mm, atol=1e-9)


def test_lengths_that_are_held_leave_the_point_their_directions() -> None:
    robot = arm(60.0, 0.4)
    assert free_directions(robot, ("aTCP", "dTCP")).shape == (3, 0)
    np.testing.assert_array_equal(free_directions(robot, ("aTCP",)), [[0.0], [0.0], [1.0]])
    assert free_directions(robot, ("thetaTCP",)).shape == (3, 3)
    own = with_own_tool_point(robot, (1.0, 2.0, 3.0))
    assert free_directions(own, ("aTCP", "jig.y")).shape == (3, 2)


def test_a_point_of_its_own_is_measured_and_leaves_the_tip() -> None:
    rng = np.random.default_rng(3)
    robot, point_mm = random_arm(rng, 6), np.array([50.0, -30.0, 120.0])
    own = with_own_tool_point(robot, point_mm)
    q = rng.normal(size=(5, 6))
    chain = forward(robot.table, q, robot.is_revolute)
    np.testing.assert_array_equal(tool_point_of(own), point_mm)
    np.testing.assert_array_equal(own.table, robot.table)
    expected = elementary_points(with_tool_point(robot, point_mm), q)
    np.testing.assert_allclose(target_points(own, q), expected, atol=1e-9)
    np.testing.assert_allclose(target_points(ending_at_tool_point(own), q), expected, atol=1e-9)
    in_tip = chain.base_T_frame[:, -1] @ tip_T_last(own) @ np.append(point_mm, 1.0)
    np.testing.assert_allclose(in_tip[:, :3], expected, atol=1e-9)


def test_how_far_a_table_turns_the_tip_about_the_last_axis() -> None:
    robot = random_arm(np.random.default_rng(4), 6)
    table = robot.table.copy()
    table[-2, 3] += 0.3  # the last joint's zero
    assert tip_turn_rad(robot, robot.with_table(table)) == pytest.approx(0.0, abs=1e-12)
    table[-1, 3] += 0.01
    assert tip_turn_rad(robot, robot.with_table(table)) == pytest.approx(0.01)


def test_the_point_of_another_table_is_told_in_the_nominal_last_frame() -> None:
    """The other table's tool point, put on the nominal arm, moves alike for every value of the last joint."""
    rng = np.random.default_rng(1)
    for nominal in (random_arm(rng, 6), random_arm(rng, 5, prismatic=4), builtin_robot("panda")):
        other = nominal.table.copy()
        other[-2:] = perturbed(nominal, rng, mm=20.0, rad=0.2).table[-2:]
        same = with_tool_point(nominal, tool_point_in_nominal(nominal, nominal.with_table(other)))
        q = rng.normal(size=(5, nominal.n_joints))
        expected = elementary_points(nominal.with_table(other), q)
        np.testing.assert_allclose(elementary_points(same, q), expected, atol=1e-9)


@pytest.mark.slow
def test_the_tolerances_of_the_last_two_rows_are_how_far_the_point_may_be_off() -> None:
    """Covariance by tolerances compared with that of random tables."""
    rng = np.random.default_rng(2)
    robot = random_arm(rng, 6)
    links = LinkErrors(robot, {"dTCP": 3.0})
    scales = np.array([p.scale for p in links.parameters]).reshape(robot.table.shape)
    scales[:-2] = 0.0
    drawn = [
        tool_point_in_nominal(robot, robot.with_table(robot.table + scales * rng.normal(size=scales.shape)))
        for _ in range(4000)
    ]
    np.testing.assert_allclose(
        tolerance_covariance(robot, links, ()) - np.eye(3), np.cov(np.transpose(drawn)), atol=0.08 * 9.0
    )
