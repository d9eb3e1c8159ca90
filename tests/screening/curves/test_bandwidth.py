"""Waves of a degree or two: learned where poses are dense enough to show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, frames
from calib.dataset.dataset import Dataset, Scanner
from calib.diagnosis.effect_selection import calibrate_with, selected_curves
from calib.kinematics.chain import nominal_chain
from calib.screening.curves.joint_curves import learn_joint_curves
from calib.screening.curves.smooth_joint_error import CurveModes
from calib.simulation.simulate import simulate_dataset

NOISE_MM = 0.03


def dense_waves(seed: int, poses: int = 100, test: int = 40) -> Dataset:
    """An RB5 within 30 deg of every joint, each with three waves of 100 to 200 a turn and 0.2 mrad."""
    rng = np.random.default_rng(seed)
    dataset = simulate_dataset("rb5", rng=seed, poses=poses + test).dataset
    robot = dataset.robot
    q = np.median(dataset.poses.q, axis=0) + np.radians(30.0) * (rng.random(dataset.poses.q.shape) - 0.5)
    error = np.zeros_like(q)
    for joint in range(robot.n_joints):
        for order in rng.integers(100, 201, 3):
            error[:, joint] += 2e-4 * np.sin(order * q[:, joint] + rng.uniform(0.0, 2.0 * np.pi))
    base_mm = nominal_chain(robot, q + error).target_mm
    seen_mm = frames.apply(frames.make_transform(np.eye(3), [1000.0, 0.0, 500.0]), base_mm)
    assert dataset.points is not None
    points = replace(dataset.points, xyz_mm=seen_mm + rng.normal(scale=NOISE_MM, size=seen_mm.shape))
    role = np.array(["reference", *["train"] * (poses - 1), *["test"] * test])
    return replace(
        dataset, poses=replace(dataset.poses, q=q, role=role), points=points, scanner=Scanner(point_sigma_mm=NOISE_MM)
    )


@pytest.mark.thorough
def test_waves_of_two_degrees_are_learned_from_dense_poses() -> None:
    dataset = dense_waves(1)
    before = calibrate(dataset)
    curves = learn_joint_curves(before)
    assert curves is not None
    orders = [member.modes.orders.max() for member in curves.members if isinstance(member.modes, CurveModes)]
    assert max(orders) == 240
    after = calibrate_with(dataset, [selected_curves(curves)]).after.test
    assert before.after.test is not None
    assert after is not None
    assert after.rmse_mm < 0.6 * before.after.test.rmse_mm
