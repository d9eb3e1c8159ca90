"""What is known before a plan is what the fit knows; what a pose would tell does not depend on the scanner's axes."""

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.files.robot_toml import builtin_robot
from calib.fitting.observations import conditions_at
from calib.planning.exchange import inverse
from calib.planning.unknowns import unknowns_of_fit, unknowns_of_robot
from calib.simulation.simulate import simulate_dataset
from tests.support.arms import random_transform
from tests.support.prediction import prediction_covariance


@pytest.fixture(scope="module")
def dataset():
    return simulate_dataset("rb5", rng=3, poses=40, setups=2).dataset


def test_before_a_plan_the_unknowns_are_known_as_the_fit_says(dataset) -> None:
    calibration = calibrate(dataset)
    unknowns = unknowns_of_fit(calibration)
    covariance, p = inverse(unknowns.prior_information), len(calibration.fit.x)
    fitted = covariance[:p, :p] * np.outer(unknowns.scales, unknowns.scales)
    size = np.sqrt(np.diag(calibration.fit.covariance))
    assert np.abs((fitted - calibration.fit.covariance) / np.outer(size, size)).max() < 1e-4
    setup = "B"
    at = 6 * list(unknowns.scanner_T_base).index(setup) + p
    known = JointKnowledge.of(calibration, setup)
    np.testing.assert_allclose(covariance[at : at + 3, at : at + 3], known.covariance[p : p + 3, p : p + 3], rtol=0.01)


def test_predicted_points_have_the_covariance_that_the_fit_gives_them(dataset) -> None:
    calibration = calibrate(dataset)
    unknowns = unknowns_of_fit(calibration)
    rows = np.flatnonzero(dataset.poses.is_test & (dataset.poses.setup == "A"))
    poses = dataset.poses.select(rows)
    columns = unknowns.columns_mm(poses)
    mine = columns @ inverse(unknowns.prior_information) @ np.swapaxes(columns, 1, 2)
    np.testing.assert_allclose(
        mine,
        prediction_covariance(calibration, conditions_at(calibration.dataset.poses, poses.q), "A"),
        rtol=1e-3,
        atol=1e-7,
    )


def test_how_the_scanner_stands_changes_nothing_that_is_told(dataset) -> None:
    robot, poses = (
        builtin_robot("panda"),
        simulate_dataset("panda", rng=1, poses=30).dataset.poses,
    )
    rng = np.random.default_rng(2)
    told = []
    for base_T_scanner in (random_transform(rng), random_transform(rng)):
        unknowns = unknowns_of_robot(robot, base_T_scanner)
        rows = unknowns.rows(poses).reshape(-1, len(unknowns.prior_information))
        parameters = unknowns.of_parameters()
        told.append(parameters.T @ inverse(unknowns.prior_information + rows.T @ rows) @ parameters)
    np.testing.assert_allclose(told[0], told[1], atol=1e-5)


def test_points_are_as_uncertain_as_the_residual_shows(dataset) -> None:
    calibration = calibrate(replace(dataset, scanner=replace(dataset.scanner, point_sigma_mm=0.01)))
    unknowns = unknowns_of_fit(calibration)
    assert np.sqrt(unknowns.noise_mm2(dataset.poses) / 3.0) == pytest.approx(calibration.sigma_mm)
