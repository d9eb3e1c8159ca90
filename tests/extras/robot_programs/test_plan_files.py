"""A plan as files: what a controller, or ROS, reads is what was planned."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.extras.robot_programs.point_lists import SLOW_RAD_S, STANDS_S
from calib.planning.plan import Plan, plan_poses
from calib.planning.start import FromRobot
from calib.workcell.known_cell import workcell_of_robot
from inspector.export.plan_files import planned_file


def planned(robot: str) -> Plan:
    return plan_poses(FromRobot(workcell_of_robot(builtin_robot(robot))), 14, candidates=60)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return planned("rb5")


def test_a_ros_trajectory_is_slow_and_stands_at_each_pose(plan: Plan) -> None:
    yaml = pytest.importorskip("yaml")
    read = yaml.safe_load(planned_file(Path("poses.yaml"), plan))
    robot = plan.start.dataset.robot
    assert read["joint_names"] == [joint.name for joint in robot.joints]
    at = np.array([point["positions"] for point in read["points"]])
    seconds = np.array([p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in read["points"]])
    np.testing.assert_allclose(at[::2], plan.poses.q, atol=1e-9)
    np.testing.assert_array_equal(at[::2], at[1::2])
    np.testing.assert_allclose(seconds[1::2] - seconds[::2], STANDS_S)
    way = np.abs(at[2::2] - at[1:-1:2]).max(axis=1)
    assert np.all(way / (seconds[2::2] - seconds[1:-1:2]) <= SLOW_RAD_S)
    assert np.all(np.diff(seconds) > 0.0)
    assert all(point["velocities"] == [0.0] * 6 for point in read["points"])


def test_a_pose_that_is_approached_from_a_side_is_come_to_from_there(plan: Plan) -> None:
    yaml = pytest.importorskip("yaml")
    side = np.where(np.arange(plan.poses.q.size).reshape(plan.poses.q.shape) % 2, 1.0, -1.0)
    sided = replace(plan, poses=replace(plan.poses, approach=side))
    at = np.array([p["positions"] for p in yaml.safe_load(planned_file(Path("a.yml"), sided))["points"]])
    arrives = np.sign(at[2::4] - at[1::4])
    inside = (np.abs(plan.poses.q) < np.radians(150.0)).all(axis=1)
    np.testing.assert_array_equal(arrives[inside], side[inside])


def test_forms_that_do_not_fit_are_refused(plan: Plan) -> None:
    with pytest.raises(CalibError, match=re.escape("poses.txt: a plan is")):
        planned_file(Path("poses.txt"), plan)
    with pytest.raises(CalibError, match="arm has 7"):
        planned_file(Path("poses.script"), planned("panda"))
