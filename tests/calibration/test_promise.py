"""Standard deviations promised for unseen poses, compared with the errors there, and the laws that they obey."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, frames
from calib.calibration.promise import (
    NEW_PLACE,
    fit_uncertainty,
    learned_discrepancy,
    misfit_inflation,
    promise,
    promised_at_points,
)
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.dataset.dataset import Dataset, Poses, Scanner
from calib.dataset.files.folder import load_dataset
from calib.fitting.discrepancy import Discrepancy
from calib.kinematics.robot import Robot
from calib.simulation.simulate import simulate_dataset
from tests.support import SHARED_DATA
from tests.support.arms import dataset_of, jang_arm, perturbed, random_transform
from tests.support.prediction import prediction_covariance
from tests.support.sweeps import sweep

TRACKED = ("ur10_ipa", "jacobi_ur5", "jacobi_wam")
TRAINING_RMS_COVERS = {"ur10_ipa": 0.906, "jacobi_ur5": 0.868, "jacobi_wam": 0.811}
NOISE_MM = 0.05


def arm(seed: int, *, train: int, test: int = 40) -> Dataset:
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    true = perturbed(robot, rng, mm=1.0, rad=np.radians(0.5))
    dataset = dataset_of(
        robot, true, rng, poses=train + test, test=test, noise_mm=NOISE_MM, base_T_scanner=random_transform(rng)
    )
    return replace(dataset, scanner=Scanner(NOISE_MM))


def coverage(calibration: Calibration) -> float:
    share = promise(calibration).coverage_90
    assert share is not None
    return share


@pytest.mark.thorough
@pytest.mark.parametrize("train", sweep([20, 50, 200], every_run=[50]))
def test_intervals_of_90_percent_hold_90_percent_where_nothing_is_missing(train: int) -> None:
    shares = [coverage(calibrate(arm(seed, train=train))) for seed in range(24)]
    # 24 fits, each a draw of its own: three standard errors of their mean, at least 2 % for the noise's own sigma.
    assert np.mean(shares) == pytest.approx(0.9, abs=max(3.0 * float(np.std(shares)) / np.sqrt(24), 0.02))
    assert np.mean(shares) == pytest.approx(0.9, abs=0.035)


@pytest.mark.thorough
@pytest.mark.parametrize("effect", ["transmission_error", "joint_compliance"])
def test_they_hold_90_percent_where_an_effect_is_missing(effect: str) -> None:
    shares = []
    for seed in range(12):
        simulated = simulate_dataset("rb5", rng=seed, effects=[effect], poses=120, conditions=True).dataset
        shares.append(coverage(calibrate(simulated)))
    assert np.mean(shares) == pytest.approx(0.9, abs=0.03)


def test_little_is_missed_where_nothing_is_missing_and_much_where_curves_are() -> None:
    complete = [learned_discrepancy(calibrate(arm(seed, train=60))) for seed in range(6)]
    assert np.median([each.constant_mm2 for each in complete]) < (0.3 * NOISE_MM) ** 2
    simulated = simulate_dataset("rb5", rng=1, effects=["transmission_error"], poses=150, conditions=True).dataset
    known = learned_discrepancy(calibrate(simulated))
    assert known.variance_mm2(simulated.poses.q + 0.5).mean() > (0.5 * NOISE_MM) ** 2


@pytest.mark.parametrize("robust", [False, True])
def test_a_fit_without_prior_promises_finite_errors(robust: bool) -> None:
    sigma_mm = promise(calibrate(arm(1, train=40), prior=False, robust=robust)).sigma_mm
    assert np.all(np.isfinite(sigma_mm))
    assert np.all(sigma_mm > 0.5 * NOISE_MM)


def test_parameters_are_moved_by_misfit_that_is_alike_at_neighbouring_poses_not_by_noise() -> None:
    complete = [misfit_inflation(calibrate(arm(seed, train=100))) for seed in range(12)]
    assert np.mean(complete) < 1.25
    hidden = [
        misfit_inflation(
            calibrate(simulate_dataset("rb5", rng=seed, effects=[("joint_scale", 8.0)], poses=130).dataset)
        )
        for seed in range(4)
    ]
    assert np.median(hidden) > 1.4 * np.mean(complete)
    assert misfit_inflation(calibrate(arm(0, train=20))) == 1.0  # too few poses for sixteen regions


def promised_covariance(calibration: Calibration, poses: Poses) -> np.ndarray:
    """Covariance (N, 3, 3), mm^2, of measured minus predicted at poses that need not be measured, from its parts."""
    fit = fit_uncertainty(calibration)
    variance = fit.single_ratio**2 * declared_sigma_mm(calibration.dataset) ** 2 + fit.discrepancy.variance_mm2(poses.q)
    return prediction_covariance(calibration, poses) + variance[:, None, None] * np.eye(3)


def away(calibration: Calibration, turn_rad: float) -> float:
    """Mean promised sigma, mm, at the training poses with each joint turned by an angle."""
    poses = calibration.dataset.poses.select(np.flatnonzero(~calibration.dataset.poses.is_test))
    covariance = promised_covariance(calibration, replace(poses, q=poses.q + turn_rad))
    return float(np.sqrt(np.mean(np.trace(covariance, axis1=1, axis2=2)) / 3.0))


def test_sigma_grows_away_from_the_training_poses() -> None:
    simulated = simulate_dataset("rb5", rng=4, effects=["transmission_error"], poses=90, conditions=True).dataset
    calibration = calibrate(simulated)
    sigma_mm = [away(calibration, angle) for angle in (0.0, 0.3, 1.0)]
    assert sigma_mm[0] < sigma_mm[1] < sigma_mm[2]


def test_a_discrepancy_grows_by_the_distance_from_the_nearest_training_pose() -> None:
    known = Discrepancy(0.01, 0.04, np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([1.0, 2.0]))
    at = np.array([[0.0, 0.0], [0.0, 2.0], [3.0, 1.0]])
    assert known.distance(at) == pytest.approx([0.0, np.sqrt(0.5), np.sqrt(2.0)])
    assert known.variance_mm2(at)[0] == pytest.approx(0.01)
    assert known.variance_mm2(at)[2] == pytest.approx(0.01 + 0.04 * np.sqrt(2.0))


def test_a_motion_of_the_instrument_changes_no_promise() -> None:
    dataset = simulate_dataset("rb5", rng=5, effects=["transmission_error"], poses=60, conditions=True).dataset
    points = dataset.points
    motion = random_transform(np.random.default_rng(7))
    moved = dataset.with_points(replace(points, xyz_mm=frames.apply(motion, points.xyz_mm)))
    first, second = (promise(calibrate(each)) for each in (dataset, moved))
    assert np.sum(first.sigma_mm**2, axis=1) == pytest.approx(np.sum(second.sigma_mm**2, axis=1), rel=1e-4)
    assert first.error_mm @ motion[:3, :3].T == pytest.approx(second.error_mm, abs=1e-5)


def test_points_and_any_poses_get_the_same_promise() -> None:
    calibration = calibrate(arm(2, train=30))
    at_points = promise(calibration)
    covariance = promised_covariance(calibration, calibration.dataset.poses)
    sigma_mm = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[at_points.pose]
    assert at_points.sigma_mm == pytest.approx(sigma_mm, rel=1e-9)


def test_a_setup_without_training_poses_is_promised_less() -> None:
    dataset = simulate_dataset("rb5", rng=3, poses=90, setups=3).dataset
    poses = dataset.poses
    last = sorted(set(poses.setup))[-1]
    role = np.where(poses.setup == last, "test", np.where(poses.role == "test", "train", poses.role))
    calibration = calibrate(replace(dataset, poses=replace(poses, role=role)))
    own = promise(calibration)
    known = replace(fit_uncertainty(calibration), discrepancy=learned_discrepancy(calibration))
    again = promised_at_points(known, calibration.dataset, calibration.after)
    assert own.sigma_mm == pytest.approx(again.sigma_mm)
    noise_mm = np.sqrt(np.mean(own.sigma_mm[own.is_test] ** 2))
    assert noise_mm > 0.9 * NEW_PLACE * calibration.sigma_mm


@pytest.mark.slow
@pytest.mark.skipif(not SHARED_DATA.is_dir(), reason="the recordings of real arms are not here")
@pytest.mark.parametrize("name", TRACKED)
def test_they_hold_90_percent_on_real_arms(name: str) -> None:
    calibration = calibrate(load_dataset(SHARED_DATA / name))
    assert coverage(calibration) == pytest.approx(0.9, abs=0.035)
    assert coverage(calibration) > TRAINING_RMS_COVERS[name]


def test_without_test_poses_there_is_no_coverage() -> None:
    robot: Robot = jang_arm()
    rng = np.random.default_rng(0)
    dataset = dataset_of(robot, perturbed(robot, rng), rng, poses=30, test=0, noise_mm=NOISE_MM)
    assert promise(calibrate(dataset)).coverage_90 is None
