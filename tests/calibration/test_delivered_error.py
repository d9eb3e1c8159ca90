"""The predicted error of the arm as delivered is what is measured, and as uncertain as it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import frames
from calib.calibration.calibrate import calibrate
from calib.calibration.delivered_error import DeliveredError, delivered_error
from calib.calibration.evaluation import evaluate
from calib.errors import FitError
from calib.fitting.observations import conditions_at
from tests.support.arms import dataset_of, elementary_points, jang_arm, perturbed


def test_at_measured_poses_it_is_the_difference_of_the_measured_errors() -> None:
    rng = np.random.default_rng(1)
    robot = jang_arm()
    fit = calibrate(dataset_of(robot, perturbed(robot, rng), rng, poses=40, noise_mm=0.05))
    at = delivered_error(fit, fit.dataset.poses.select(fit.after.pose), "")
    in_scanner_mm = at.error_mm @ fit.after.scanner_T_base[""][:3, :3].T
    np.testing.assert_allclose(in_scanner_mm, fit.before.error_mm - fit.after.error_mm, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(at.covariance_mm2) > 0.0)
    assert np.median(at.sigma_mm) < 0.2 * np.median(at.length_mm)


def test_it_is_less_certain_far_from_the_training_poses() -> None:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    fit = calibrate(dataset_of(robot, perturbed(robot, rng), rng, poses=40, noise_mm=0.05, range_rad=0.4))
    far = conditions_at(fit.dataset.poses, np.array([[0.1] * 6, [2.5] * 6]))
    sigma = delivered_error(fit, far, "").sigma_mm
    assert sigma[1] > 3.0 * sigma[0]
    with pytest.raises(FitError, match="'left'"):
        delivered_error(fit, far, "left")


def test_sigma_is_that_along_the_error() -> None:
    covariance = np.diag([0.04, 0.01, 0.09])[None]
    assert DeliveredError(np.array([[2.0, 0.0, 0.0]]), covariance).sigma_mm[0] == pytest.approx(0.2)
    assert DeliveredError(np.array([[0.0, -1.0, 0.0]]), covariance).sigma_mm[0] == pytest.approx(0.1)
    assert DeliveredError(np.zeros((1, 3)), covariance).sigma_mm[0] == pytest.approx(0.3)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("range_rad", [np.pi, 0.6])
def test_it_errs_as_much_as_it_says(range_rad: float) -> None:
    """The mean squared Mahalanobis distance to the true error, over arms drawn from the prior, is 3.

    The true error is that of the delivered arm where it fits the points without noise best.
    """
    robot = jang_arm()
    squared = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        true = perturbed(robot, rng, mm=1.0, rad=np.radians(0.5))
        fit = calibrate(dataset_of(robot, true, rng, poses=40, noise_mm=0.05, range_rad=range_rad))
        cell = fit.dataset
        assert cell.points is not None
        exact_mm = elementary_points(true, cell.poses.q)[cell.points.pose]
        exact = evaluate(
            fit.model, fit.model.delivered(fit.fit.x), cell.with_points(replace(cell.points, xyz_mm=exact_mm))
        )
        poses = conditions_at(cell.poses, rng.uniform(-1.2 * range_rad, 1.2 * range_rad, (6, 6)))
        nominal_mm = fit.model.predict(fit.model.delivered(fit.fit.x), poses)
        true_mm = frames.apply(exact.scanner_T_base[""], nominal_mm) - elementary_points(true, poses.q)
        at = delivered_error(fit, poses, "")
        difference = at.error_mm - true_mm @ fit.after.scanner_T_base[""][:3, :3]
        squared += np.einsum("ni,nij,nj->n", difference, np.linalg.inv(at.covariance_mm2), difference).tolist()
    assert 2.2 < float(np.mean(squared)) < 4.0
