"""The covariance of check poses: a dense matrix's figures, memory that grows with the poses, no noise too small."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calib import calibrate
from calib.dataset.dataset import Dataset, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import FitError
from calib.extras.watch.spread import LIMIT_SHARE, Spread
from calib.extras.watch.watch import watch
from calib.options import FitOptions
from calib.simulation.simulate import simulate_dataset
from calib.statistics import covariance_root

M = 12


def drawn(seed: int, noise: float, *, blind: bool) -> tuple[Spread, np.ndarray, np.ndarray]:
    """A spread, the dense covariance it is of, and an orthonormal basis of what it is asked."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(3 * M, 9)) * 10.0 ** rng.uniform(-3, 3, 9)
    root = rng.normal(size=(9, 6)) * 0.3
    covariance = root @ root.T  # singular: some combinations are known exactly
    frame = rng.normal(size=(3 * M, 6)) if blind else None
    spread = Spread.of(columns, covariance, noise, frame)
    rest = np.eye(3 * M) if frame is None else np.linalg.svd(frame)[0][:, 6:]
    dense = rest.T @ (columns @ covariance @ columns.T) @ rest + noise**2 * np.eye(rest.shape[1])
    return spread, dense, rest


@pytest.mark.parametrize("blind", [False, True])
@pytest.mark.parametrize("noise", [1.0, 0.02])
def test_it_whitens_and_adds_up_as_the_dense_matrix_does(noise: float, blind: bool) -> None:
    spread, dense, rest = drawn(3, noise, blind=blind)
    rng = np.random.default_rng(4)
    y, blocks = rng.normal(size=3 * M), rng.normal(size=(M, 3, 3))
    white = spread.whiten(y)
    assert white @ white == pytest.approx(rest.T @ y @ np.linalg.solve(dense, rest.T @ y), rel=1e-6)
    assert spread.rows == rest.shape[1]
    whole = np.zeros((M, 3, M, 3))
    whole[np.arange(M), :, np.arange(M)] = blocks
    rows = spread.whiten(whole.reshape(3 * M, 3 * M))
    assert spread.total_weight(blocks) == pytest.approx(np.sum(rows**2), rel=1e-6)
    limit_mm = spread.limit_mm(blocks)
    turned = whole.reshape(3 * M, 3 * M) @ rest
    expected = turned @ dense @ turned.T
    mean, squares = np.trace(expected), np.sum(expected**2)
    assert M * limit_mm**2 == pytest.approx(squares / mean * chi2.ppf(LIMIT_SHARE, mean**2 / squares))


def test_a_root_is_found_where_rounding_leaves_no_positive_matrix() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(30, 4)) * 10.0 ** rng.uniform(-8, 4, (30, 1))
    covariance = root @ root.T
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(covariance)
    found = covariance_root(covariance)
    scale = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(
        found @ found.T / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-12
    )


def cell(number: int) -> tuple[Dataset, FitOptions]:
    """Random: arm, poses, noise down to none at all, declared rightly, wrongly or not, any kind of residual."""
    rng = np.random.default_rng([78, number])
    noise_mm = (0.0, 1e-9, 1e-6, 1e-4, 0.05)[number % 5]
    robot = builtin_robot(("rb5", "panda")[number % 2])
    dataset = simulate_dataset(robot, rng=rng, poses=int(rng.integers(6, 60)), noise_mm=noise_mm).dataset
    declared = int(rng.integers(4))
    if declared < 2:
        dataset = replace(dataset, scanner=Scanner(point_sigma_mm=None if declared == 0 else 0.05))
    options = FitOptions(
        prior=bool(rng.random() < 0.7), residual=("position", "distance", "pairs")[int(rng.integers(3))]
    )
    return dataset, options


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize("numbers", [range(40), range(40, 200)], ids=str)
def test_an_arm_against_itself_is_unchanged_whatever_the_noise(numbers: range) -> None:
    watched = 0
    for number in numbers:
        dataset, options = cell(number)
        try:
            base = calibrate(dataset, options)
        except FitError:  # too few poses for a fit without a prior
            continue
        for new in (dataset, replace(dataset, poses=replace(dataset.poses, setup=np.full(len(dataset.poses), "x")))):
            found = watch(base, new)
            if np.isfinite(base.fit.reduced_chi):  # else no degree of freedom tells how far the earlier fit is right
                assert found.verdict == "unchanged", (number, found.headline)
            assert np.isfinite([found.rmse_mm, found.expected_mm, found.limit_mm, found.p_unchanged]).all()
        watched += 1
    assert watched > 0.6 * len(numbers)


@pytest.mark.slow
def test_memory_grows_with_the_poses_not_with_their_square() -> None:
    base = calibrate(simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(1), poses=64).dataset)
    peaks = []
    for poses in (300, 1200):
        new = simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(1), poses=poses).dataset
        tracemalloc.start()
        watch(base, new)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 6.0 * peaks[0], peaks  # four times the poses
    assert peaks[1] < 60e6
