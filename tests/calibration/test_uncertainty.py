"""Uncertainties of fits compared with the actual errors over many simulated arms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from calib import calibrate, frames
from calib.calibration.uncertainty import (
    combination,
    correlated_pairs,
    identifiable_combinations,
)
from calib.errors import FitError
from calib.fitting.observations import conditions_at
from calib.kinematics.tool_point import ending_at_tool_point
from calib.screening.curves.joint_curves import learn_joint_curves
from tests.support.arms import dataset_of, elementary_points, jang_arm, park_arm, perturbed
from tests.support.changed import with_xyz
from tests.support.prediction import prediction_covariance


def test_sums_are_known_although_their_parts_are_not() -> None:
    rng = np.random.default_rng(0)
    robot = park_arm("rb5")
    true = perturbed(robot, rng, mm=0.5, rad=0.001)
    result = calibrate(dataset_of(robot, true, rng, noise_mm=0.03))
    sums = {c.description: c for c in identifiable_combinations(result)}
    assert {"d2 + d3 + d4", "a6 + aTCP", "theta4 - beta4"} <= set(sums)
    for words in ("a6 + aTCP", "d2 + d3 + d4", "d6 + dTCP"):
        known = sums[words]
        assert known.sigma < 0.2 * known.worst_part_sigma, words
    truth = dict(zip(robot.parameter_names, true.table.ravel(), strict=True))
    known = sums["a6 + aTCP"]
    assert abs(known.value - truth["a6"] - truth["aTCP"]) < 5 * known.sigma


@pytest.mark.slow
def test_a_sum_that_these_poses_leave_open_is_not_called_known() -> None:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    few = calibrate(dataset_of(robot, perturbed(robot, rng), rng, poses=10, noise_mm=0.03, range_rad=0.01))
    many = calibrate(dataset_of(robot, perturbed(robot, rng), rng, poses=60, noise_mm=0.03))
    told = [{c.description for c in identifiable_combinations(result)} for result in (few, many)]
    assert "d6 + dTCP" in told[1]
    assert told[0] < told[1]
    both = combination(few, {"d6": 1.0, "dTCP": 1.0})
    assert not both.is_known
    assert (both.unit, both.tolerance) == ("mm", 1.0)
    assert combination(many, {"a2": 1.0, "theta2": 1.0}).unit == ""


def test_any_sum_can_be_asked_for_and_an_unknown_name_is_refused() -> None:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    result = calibrate(dataset_of(robot, perturbed(robot, rng), rng, noise_mm=0.03))
    half = combination(result, {"a2": 0.5, "a3": -2.0})
    assert half.description == "0.5 a2 - 2 a3"
    table = result.robot.table
    assert half.value == pytest.approx(0.5 * table[1, 0] - 2 * table[2, 0])
    with pytest.raises(FitError, match="'x1'"):
        combination(result, {"x1": 1.0})


def test_pairs_that_blur_each_other_are_named() -> None:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    pairs = correlated_pairs(calibrate(dataset_of(robot, perturbed(robot, rng), rng, noise_mm=0.03)))
    found = {frozenset((p.first, p.second)) for p in pairs}
    assert frozenset(("d6", "dTCP")) in found  # only their sum is known: their errors are opposite
    assert all(abs(pair.r) > 0.8 for pair in pairs)
    assert [abs(p.r) for p in pairs] == sorted((abs(p.r) for p in pairs), reverse=True)


@pytest.mark.parametrize("range_rad", [np.pi, 0.6])
@pytest.mark.thorough
def test_predictions_err_as_much_as_they_say(range_rad: float) -> None:
    """The mean squared Mahalanobis distance of predicted points over arms drawn from the prior is 3."""
    robot = jang_arm()
    squared = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        true = perturbed(robot, rng, mm=1.0, rad=np.radians(0.5))
        result = calibrate(dataset_of(robot, true, rng, poses=40, noise_mm=0.05, range_rad=range_rad))
        q = rng.uniform(-1.2 * range_rad, 1.2 * range_rad, (6, 6))
        covariance = prediction_covariance(result, conditions_at(result.dataset.poses, q))
        fitted = ending_at_tool_point(result.robot)
        predicted = frames.apply(result.after.scanner_T_base[""], elementary_points(fitted, q))
        error = predicted - elementary_points(true, q)
        squared += np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error).tolist()
    assert 2.2 < float(np.mean(squared)) < 4.0


def test_far_from_the_training_poses_a_prediction_is_worse() -> None:
    rng = np.random.default_rng(0)
    robot = jang_arm()
    result = calibrate(dataset_of(robot, perturbed(robot, rng), rng, poses=40, noise_mm=0.05, range_rad=0.4))
    poses = result.dataset.poses
    near, far = prediction_covariance(result, conditions_at(poses, np.array([[0.1] * 6, [2.5] * 6])))
    assert np.trace(far) > 10 * np.trace(near)
    with pytest.raises(FitError, match="'left'"):
        prediction_covariance(result, conditions_at(poses, np.zeros((1, 6))), setup="left")


@pytest.mark.slow
def test_a_curve_over_a_further_column_is_predicted_elsewhere_too() -> None:
    """A curve of joint 2 over a pressure column: predictions at other joint vectors use the first pose's pressure."""
    rng = np.random.default_rng(3)
    robot = jang_arm()
    pressure_bar = rng.uniform(80.0, 120.0, 64)
    cell = dataset_of(robot, robot, rng, poses=64, noise_mm=0.0)
    q = cell.poses.q.copy()
    q[:, 1] += 2e-5 * (pressure_bar - 100.0)
    assert cell.points is not None
    xyz_mm = elementary_points(robot, q) + rng.normal(size=(64, 3)) * 0.05
    poses = replace(cell.poses, extra=pd.DataFrame({"pressure_bar": pressure_bar}))
    cell = replace(with_xyz(cell, xyz_mm), poses=poses)
    learned = learn_joint_curves(calibrate(cell))
    assert learned.inputs == ("pressure_bar",)
    fitted = calibrate(cell, effects=learned.members)
    covariance = prediction_covariance(fitted, conditions_at(poses, poses.q[:2]))
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    at_mm = fitted.model.predict(fitted.fit.x, conditions_at(poses, poses.q[:1]))
    moved_mm = fitted.model.predict(fitted.fit.x, poses.select(np.arange(1)))
    np.testing.assert_allclose(at_mm, moved_mm, atol=1e-9)
