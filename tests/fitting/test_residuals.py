"""Residuals compared with brute force: distances with full covariance, eliminated frames, derivatives."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.robust import tukey_weights
from calib.fitting.trust_region import solve
from calib.options import RESIDUAL_KINDS
from tests.support.arms import dataset_of, elementary_points, jang_arm, perturbed, random_transform
from tests.support.fit_cases import check_gradient, with_point_covariances

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("kind", [kind for kind in RESIDUAL_KINDS if kind != "pose"])  # see test_pose_residuals
def test_the_jacobian_is_the_derivative_of_the_cost(kind: str) -> None:
    """The cost's gradient 2 J^T r is exact although elimination changes the residual's derivative."""
    rng = np.random.default_rng(1)
    robot = jang_arm()
    dataset = with_point_covariances(dataset_of(robot, perturbed(robot, rng), rng, poses=20, noise_mm=0.05), rng)
    check_gradient(make_residuals(kind, geometric_model(robot), Observations.of(dataset)), rng)


def test_pairs_are_all_distances_with_the_covariance_they_have() -> None:
    """Normal matrix and right-hand side equal those of generalised least squares on all distances."""
    rng = np.random.default_rng(2)
    robot = jang_arm()
    dataset = with_point_covariances(dataset_of(robot, perturbed(robot, rng, mm=1e-4, rad=1e-7), rng, poses=9), rng)
    observed = Observations.of(dataset)
    residuals = make_residuals("pairs", geometric_model(robot), observed)
    x = np.zeros(len(residuals.parameters))
    at = residuals.linearise(x)

    nominal = elementary_points(robot, dataset.poses.q)
    measured = observed.points.xyz_mm
    by_x = geometric_model(robot).linearise(x, dataset.poses)[1]
    pairs = list(combinations(range(9), 2))
    lengths, jacobian, by_points = [], [], np.zeros((len(pairs), 27))
    for row, (i, j) in enumerate(pairs):
        along = (nominal[j] - nominal[i]) / np.linalg.norm(nominal[j] - nominal[i])
        lengths.append(np.linalg.norm(nominal[j] - nominal[i]) - np.linalg.norm(measured[j] - measured[i]))
        jacobian.append(along @ (by_x[j] - by_x[i]))
        by_points[row, 3 * j : 3 * j + 3], by_points[row, 3 * i : 3 * i + 3] = along, -along
    # Covariances are given in the scanner's frame; here that is the base frame.
    covariance = np.zeros((27, 27))
    for i in range(9):
        covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = observed.covariance_mm2[i]
    weight = np.linalg.pinv(by_points @ covariance @ by_points.T, rcond=1e-10)
    normal = np.array(jacobian).T @ weight @ np.array(jacobian)
    right = np.array(jacobian).T @ weight @ np.array(lengths)
    size = np.sqrt(np.outer(np.diag(normal), np.diag(normal))) + 1e-9 * normal.max()
    np.testing.assert_allclose(at.jacobian.T @ at.jacobian / size, normal / size, atol=1e-5)
    np.testing.assert_allclose(at.jacobian.T @ at.residual, right, atol=1e-4 * np.abs(right).max())


@pytest.mark.slow
@settings(max_examples=10)
@given(SEEDS)
def test_pairs_and_positions_are_one_fit_whatever_the_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    dataset = dataset_of(
        robot, perturbed(robot, rng), rng, poses=40, noise_mm=0.05, base_T_scanner=random_transform(rng)
    )
    fits = [solve(make_residuals(k, geometric_model(robot), Observations.of(dataset))) for k in ("pairs", "position")]
    np.testing.assert_allclose(fits[0].x, fits[1].x, atol=1e-9)


def test_a_frame_ten_metres_away_costs_no_accuracy() -> None:
    rng = np.random.default_rng(5)
    robot = jang_arm()
    true = perturbed(robot, rng)
    costs = []
    for offset_mm in (0.0, 1e4):
        base_T_scanner = np.eye(4)
        base_T_scanner[:3, 3] = offset_mm
        dataset = dataset_of(robot, true, np.random.default_rng(6), noise_mm=0.05, base_T_scanner=base_T_scanner)
        costs.append(solve(make_residuals("position", geometric_model(robot), Observations.of(dataset))).x)
    np.testing.assert_allclose(costs[1], costs[0], atol=1e-6)


def test_tukey_weights_do_not_depend_on_the_scale() -> None:
    norm, rows = np.abs(np.random.default_rng(0).normal(size=200)) + 0.1, np.full(200, 3)
    np.testing.assert_allclose(tukey_weights(norm, rows), tukey_weights(1e3 * norm, rows))
    assert np.all(tukey_weights(np.zeros(5), rows[:5]) == 1.0)
