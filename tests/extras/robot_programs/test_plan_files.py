"""A plan as files: what a controller reads is what was planned."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.planning.plan import Plan, plan_poses
from calib.planning.start import FromRobot
from calib.workcell.known_cell import workcell_of_robot
from inspector.export.plan_files import planned_file


def planned(robot: str) -> Plan:
    return plan_poses(FromRobot(workcell_of_robot(builtin_robot(robot))), 14, candidates=60)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return planned("rb5")


def test_a_pose_that_is_approached_from_a_side_is_come_to_from_there(plan: Plan) -> None:
    side = np.where(np.arange(plan.poses.q.size).reshape(plan.poses.q.shape) % 2, 1.0, -1.0)
    text = planned_file(Path("a.script"), replace(plan, poses=replace(plan.poses, approach=side)))
    at = np.array([[float(v) for v in row.split(",")] for row in re.findall(r"= \[([^\]]*)\]", text)])
    np.testing.assert_allclose(at[1::2], plan.poses.q, atol=1e-8)
    inside = (np.abs(plan.poses.q) < np.radians(150.0)).all(axis=1)
    np.testing.assert_array_equal(np.sign(at[1::2] - at[::2])[inside], side[inside])


def test_forms_that_do_not_fit_are_refused(plan: Plan) -> None:
    with pytest.raises(CalibError, match=re.escape("poses.txt: a plan is")):
        planned_file(Path("poses.txt"), plan)
    with pytest.raises(CalibError, match="arm has 7"):
        planned_file(Path("poses.script"), planned("panda"))
