"""Errors by pose: noise bands and the running median."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.pose_errors import pose_errors_of, running_median
from calib.kinematics.chain import target_points
from calib.simulation.simulate import simulate_dataset


def test_a_running_median_keeps_straight_lines_and_ignores_single_points() -> None:
    rng = np.random.default_rng(0)
    x = rng.permutation(30).astype(float)
    y = 2.0 * x + 1.0
    at, smooth = running_median(x, y)
    np.testing.assert_array_equal(at, np.arange(30.0))
    np.testing.assert_allclose(smooth, 2.0 * at + 1.0)
    y[np.flatnonzero(x == 15)] = 1e6
    np.testing.assert_allclose(running_median(x, y)[1], 2.0 * at + 1.0, atol=2.1)


def test_a_running_median_stops_at_gaps() -> None:
    x = np.concatenate([np.linspace(0, 1, 20), np.linspace(9, 10, 20)])
    y = np.where(x < 5, 3.0, -3.0)
    at, smooth = running_median(x, y)
    between = np.flatnonzero(np.isnan(at))
    assert between.tolist() == [20]
    assert np.isnan(smooth[20])
    assert set(smooth[:20]) == {3.0}  # no window reaches over the gap
    assert set(smooth[21:]) == {-3.0}


def test_levels_give_one_median_each_and_lone_points_none() -> None:
    x = np.array([20.0] * 5 + [30.0] * 4 + [70.0])
    y = np.array([1.0, 2.0, 3.0, 50.0, 0.0, 4.0, 4.0, 6.0, 6.0, 9.0])
    at, smooth = running_median(x, y)
    np.testing.assert_array_equal(at, [20.0, np.nan, 30.0])
    np.testing.assert_array_equal(smooth, [2.0, np.nan, 5.0])
    assert len(running_median([1.0], [2.0])[0]) == 0
    assert running_median([1.0] * 3, [2.0, 4.0, np.nan])[0].size == 0


def test_test_poses_are_predicted_and_lie_where_the_arm_is() -> None:
    dataset = simulate_dataset("rb5", rng=3, effects=["joint_compliance"], noise_mm=0.02).dataset
    result = calibrate(dataset)
    pose_errors = pose_errors_of(result)
    assert pose_errors.pose_ids == dataset.poses.ids
    np.testing.assert_array_equal(pose_errors.is_test, dataset.poses.is_test)
    for role, figures in (
        (pose_errors.is_test, result.after.test),
        (~pose_errors.is_test, result.after.train),
    ):
        assert np.sqrt(np.mean(pose_errors.error_length_mm[role] ** 2)) == pytest.approx(figures.rmse_mm)
    frame = pose_errors.to_frame()
    assert frame["role"].tolist() == np.where(dataset.poses.is_test, "test", "train").tolist()
    # The nominal chain is right to a few millimetres, and knows nothing of the scanner.
    nominal_mm = target_points(dataset.robot, dataset.poses.q)
    assert np.linalg.norm(pose_errors.place_mm - nominal_mm, axis=1).max() < 15.0
    worst = pose_errors.worst(3)
    assert worst[0] == dataset.poses.ids[int(np.argmax(pose_errors.error_length_mm))]


def test_noise_alone_stays_in_the_bands_as_often_as_they_say() -> None:
    dataset = simulate_dataset("rb5", rng=5, poses=400).dataset
    pose_errors = pose_errors_of(calibrate(dataset))
    assert abs(np.mean(pose_errors.error_length_mm < pose_errors.length_noise_mm) - 0.95) < 0.04
    for joint in range(6):
        told = np.isfinite(pose_errors.apparent_joint_noise[:, joint])
        normal = pose_errors.apparent_joint_error[told, joint] / pose_errors.apparent_joint_noise[told, joint]
        assert 0.8 < np.std(normal) < 1.15
    assert pose_errors.joint_noise(0) == np.median(pose_errors.apparent_joint_noise[:, 0])
