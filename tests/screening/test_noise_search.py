"""The shape of the noise, found in what a fit of a clean arm leaves over, and its likelihood by dense matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.result import declared_sigma_mm
from calib.fitting.observations import Observations
from calib.noise_shape import CorrelatedDrift, NoiseShape
from calib.screening.noise_likelihood import LinearResidual, scatter_of_repeats
from calib.screening.noise_search import FoundShape, find_shape, judge_tails
from calib.screening.projected_residual import project_residual
from tests.support.odd_noise import SIGMA_MM, odd_arm


def left_over(kind: str, seed: int) -> LinearResidual:
    return LinearResidual.of(project_residual(calibrate(odd_arm(kind, seed))))


def found_in(kind: str, seed: int) -> FoundShape | None:
    residual = left_over(kind, seed)
    return find_shape(residual, np.zeros(len(residual.rows), dtype=bool))


def test_the_likelihood_is_that_of_dense_matrices() -> None:
    residual = left_over("white", 0)
    wander = CorrelatedDrift(0.4, 120.0)
    axes = ((1.3, 0.1, 0.0), (0.1, 0.9, 0.2), (0.0, 0.2, 1.1))
    shape = NoiseShape(1.2, 2.0, axes, growth_per_m=0.4, distance_mm=1000.0, wander=wander)

    xyz, count = residual.xyz_mm, len(residual.rows)
    factors = []
    for point in xyz:
        sight = point / np.linalg.norm(point)
        size = 1.2 * np.exp(0.4e-3 * (np.linalg.norm(point) - 1000.0))
        factors.append(size * np.array(axes) @ (np.eye(3) + np.outer(sight, sight)))
    at = np.cumsum(np.where(np.isinf(residual.moments.gap), 0.0, residual.moments.gap))[residual.moments.of_point]
    in_time = 0.6 * np.eye(count) + 0.4 * np.exp(-np.abs(at[:, None] - at) / 120.0)
    whole = np.zeros((3 * count, 3 * count))
    for i in range(count):
        for j in range(count):
            block = residual.whiten[i] @ factors[i] @ np.linalg.inv(residual.whiten[i])
            other = residual.whiten[j] @ factors[j] @ np.linalg.inv(residual.whiten[j])
            whole[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = in_time[i, j] * block @ other.T

    def restricted(covariance: np.ndarray) -> float:
        flat = residual.rows.reshape(3 * count, -1)
        y, x = flat[:, 0], flat[:, 1:]
        inverse = np.linalg.inv(covariance)
        information = x.T @ inverse @ x
        left = y @ inverse @ y - (x.T @ inverse @ y) @ np.linalg.solve(information, x.T @ inverse @ y)
        logs = [np.linalg.slogdet(covariance)[1], np.linalg.slogdet(information)[1]]
        return float(-0.5 * sum(logs) - 0.5 * (3 * count - x.shape[1]) * np.log(left))

    ours = residual.log_likelihood(shape) - residual.log_likelihood(NoiseShape())
    assert ours == pytest.approx(restricted(whole) - restricted(np.eye(3 * count)), abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_white_noise_has_no_shape(seed: int) -> None:
    assert found_in("white", seed) is None


@pytest.mark.parametrize("seed", range(3))
def test_depth_three_times_coarser_is_found_along_its_axis(seed: int) -> None:
    found = found_in("deep", seed)
    assert found.shape.depth == 1.0
    assert found.shape.wander is None
    across, between, along = np.diag(found.shape.axes)
    assert across == between == 1.0
    assert along == pytest.approx(3.0, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_growth_with_distance_is_found(seed: int) -> None:
    """The engine's noise grows with the square of the distance: 2 / d relative to itself."""
    residual = left_over("growing", seed)
    found = find_shape(residual, np.zeros(len(residual.rows), dtype=bool))
    assert found.shape.axes == NoiseShape().axes
    expected = 2.0 / np.median(np.linalg.norm(residual.xyz_mm, axis=1)) * 1e3
    assert found.shape.growth_per_m == pytest.approx(expected, rel=0.5)


@pytest.mark.parametrize("seed", [4, 5, 9])
def test_a_wander_is_found_with_its_share(seed: int) -> None:
    found = found_in("wandering", seed)
    assert not found.shape.reshapes_points
    assert 0.2 <= found.shape.wander.share <= 0.8  # a half


def test_tails_are_found_and_single_wrong_points_are_none() -> None:
    rng = np.random.default_rng(3)
    tails = judge_tails(rng.standard_t(3.0, (64, 3)))
    assert tails.of_tails > tails.of_outliers + 3.0
    assert tails.of_tails > 8.0
    assert tails.tail < 6.0
    wrong = rng.standard_normal((64, 3))
    wrong[[5, 20]] += [[12.0, 3.0, 0.0], [0.0, -20.0, 5.0]]
    points = judge_tails(wrong)
    assert points.of_outliers > points.of_tails + 3.0


@pytest.mark.parametrize("kind", ["deep", "growing"])
def test_the_shape_keeps_the_declared_size(kind: str) -> None:
    dataset = odd_arm(kind, 1)
    found = found_in(kind, 1)
    shaped = replace(dataset, noise=found.shape)
    assert declared_sigma_mm(shaped) == pytest.approx(SIGMA_MM, rel=1e-9)
    sizes = np.trace(Observations.of(shaped).covariance_mm2, axis1=1, axis2=2)
    assert (np.ptp(sizes) > 1e-6) == (kind == "growing")


@pytest.mark.slow
def test_repeats_tell_the_shape_whatever_the_arm_does() -> None:
    dataset = odd_arm("deep", 2, ["joint_compliance"], sigmas=20.0, repeats=2)
    scatter = scatter_of_repeats(dataset)
    assert scatter.rows.shape == (80, 3, 1)
    found = find_shape(scatter, np.zeros(80, dtype=bool), drifts=False)
    assert found.shape.axes[2][2] == pytest.approx(3.0, rel=0.25)
    assert np.mean(scatter.rows**2) == pytest.approx(1.0, rel=0.3)  # whitened by the declared sigma
    assert scatter_of_repeats(odd_arm("deep", 2)) is None
