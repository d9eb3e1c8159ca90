"""Inverse kinematics: both rules meet goals that can be met, stay in the box, and say how near they came otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from calib import frames
from calib.array_types import Array, IndexArray
from calib.kinematics.chain import forward, joint_jacobian, target_points
from calib.kinematics.inverse import FROM_ANYWHERE, FROM_NEARBY, StepRule, solve_inverse
from calib.kinematics.robot import Robot
from tests.support.arms import park_arm, random_arm


@dataclass(frozen=True)
class Points:
    """The tool point at N places."""

    robot: Robot
    goal_mm: Array

    @property
    def joint_units(self) -> Array:
        return np.ones(self.robot.n_joints)

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        chain = forward(self.robot.table, q, self.robot.is_revolute)
        return self.goal_mm[rows] - chain.target_mm, joint_jacobian(chain, self.robot.is_revolute)[0]


@pytest.mark.parametrize(("rule", "off_rad"), [(FROM_NEARBY, 0.1), (FROM_ANYWHERE, 2.0)], ids=str)
def test_goals_within_reach_are_met(rule: StepRule, off_rad: float) -> None:
    rng, robot = np.random.default_rng(4), park_arm("rb5")
    there = rng.uniform(-2.0, 2.0, (50, robot.n_joints))
    goals = Points(robot, target_points(robot, there))
    start = there + rng.uniform(-off_rad, off_rad, there.shape)
    free = np.full_like(start, np.inf)
    q = solve_inverse(goals, start, -free, free, rule)
    off_mm = np.linalg.norm(target_points(robot, q) - goals.goal_mm, axis=1)
    assert np.mean(off_mm < 1e-6) >= (1.0 if rule is FROM_NEARBY else 0.9)  # some start in a dead end


@pytest.mark.parametrize("rule", [FROM_NEARBY, FROM_ANYWHERE], ids=str)
def test_joints_stay_in_their_box(rule: StepRule) -> None:
    rng, robot = np.random.default_rng(5), park_arm("rb5")
    start = rng.uniform(-2.0, 2.0, (50, robot.n_joints))
    goals = Points(robot, target_points(robot, start + rng.uniform(-0.3, 0.3, start.shape)))
    low, high = start - 0.1, start + 0.1
    q = solve_inverse(goals, start, low, high, rule)
    assert np.all((q >= low) & (q <= high))
    before, after = (np.linalg.norm(target_points(robot, at) - goals.goal_mm, axis=1) for at in (start, q))
    assert np.all(after < before)


def test_a_redundant_arm_moves_the_least() -> None:
    rng, robot = np.random.default_rng(6), park_arm("panda")
    start = rng.uniform(-1.0, 1.0, (20, robot.n_joints))
    goals = Points(robot, target_points(robot, start) + rng.uniform(-5.0, 5.0, (20, 3)))
    free = np.full_like(start, np.inf)
    q = solve_inverse(goals, start, -free, free)
    _, jacobian = goals.linearise(q, np.arange(20))
    idle = np.einsum("kni,ki->kn", np.eye(7) - np.linalg.pinv(jacobian) @ jacobian, q - start)
    np.testing.assert_allclose(idle, 0.0, atol=1e-9)


@pytest.mark.parametrize("prismatic", [None, 2])
def test_the_joints_jacobian_is_the_derivative(prismatic: int | None) -> None:
    rng = np.random.default_rng(7)
    robot = random_arm(rng, 5, prismatic=prismatic)
    q, step = rng.uniform(-1.0, 1.0, (4, 5)), 1e-6
    moved, turned = joint_jacobian(forward(robot.table, q, robot.is_revolute), robot.is_revolute)
    for j in range(5):
        off = step * np.eye(5)[j]
        before, after = (forward(robot.table, q + s * off, robot.is_revolute) for s in (-1.0, 1.0))
        np.testing.assert_allclose(moved[:, :, j], (after.target_mm - before.target_mm) / (2.0 * step), atol=1e-5)
        turn = after.base_T_frame[:, -1, :3, :3] @ np.swapaxes(before.base_T_frame[:, -1, :3, :3], 1, 2)
        np.testing.assert_allclose(turned[:, :, j], frames.rotvec_from_rotation(turn) / (2.0 * step), atol=1e-7)
