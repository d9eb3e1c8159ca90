"""What is left over: its noise bands and its smooth."""

from __future__ import annotations

import numpy as np

from calib.calibration import calibrate
from calib.failure import failure_of, running_median
from calib.robot_file import builtin_robot
from calib.simulation import simulate_dataset


def test_a_running_median_keeps_straight_lines_and_ignores_single_points() -> None:
    rng = np.random.default_rng(0)
    x = rng.permutation(30).astype(float)
    y = 2.0 * x + 1.0
    at, smooth = running_median(x, y)
    np.testing.assert_array_equal(at, np.arange(30.0))
    np.testing.assert_allclose(smooth, 2.0 * at + 1.0)
    y[np.flatnonzero(x == 15)] = 1e6
    np.testing.assert_allclose(running_median(x, y)[1], 2.0 * at + 1.0, atol=2.1)


def test_noise_alone_stays_in_the_bands_as_often_as_they_say() -> None:
    dataset = simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(5), poses=400).dataset
    failure = failure_of(calibrate(dataset))
    assert abs(np.mean(failure.error_length_mm < failure.length_noise_mm) - 0.95) < 0.04
    for joint in range(6):
        told = np.isfinite(failure.apparent_joint_noise[:, joint])
        normal = failure.apparent_joint_error[told, joint] / failure.apparent_joint_noise[told, joint]
        assert 0.8 < np.std(normal) < 1.15
    assert failure.joint_noise(0) == np.median(failure.apparent_joint_noise[:, 0])
