"""Known places that are off, such as the sockets of a printed plate: their errors are in what is told of lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, load_dataset
from calib.errors import DatasetError
from tests.support.commands import printed
from tests.support.scenarios.shop import LIMITS_DEG, above_table, in_sockets


def _visited(folder, seed, postures):
    """Visits of a printed plate, 0.1 mm off, seated to 0.05 mm: true arm, by kinematics of its own, and dataset."""
    shop = in_sockets(seed, postures=postures, seat_mm=0.05)
    shop.write(folder / "files")
    words = ["import", str(folder / "cell"), "--from", str(folder / "files")]
    printed(*words, "--sigma", "0.05", "--place-sigma", "0.1")
    return shop.arm, load_dataset(folder / "cell")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return _visited(tmp_path_factory.mktemp("plate"), 0, 2)[1]


def _scale(arm, fitted, rng) -> tuple[float, float]:
    """Error of the calibrated arm's size at new poses, as a share, and its sigma by the fit's covariance."""
    q = np.array([above_table(arm, np.radians(LIMITS_DEG), rng) for _ in range(60)])
    true = np.array([1e3 * arm.tool(one) for one in q])

    def size(x):
        robot = fitted.model
        poses = replace(fitted.dataset.poses.select(np.zeros(len(q), dtype=int)), q=q)
        points = robot.predict(x, poses)
        return np.linalg.norm(points - points.mean(axis=0), axis=1).mean()

    at, steps = size(fitted.fit.x), fitted.model.scales * 1e-4
    slope = np.array(
        [(size(fitted.fit.x + step * axis) - at) / step for step, axis in zip(steps, np.eye(len(steps)), strict=True)]
    )
    true_size = np.linalg.norm(true - true.mean(axis=0), axis=1).mean()
    return at / true_size - 1.0, float(np.sqrt(slope @ fitted.fit.covariance @ slope)) / true_size


@pytest.mark.thorough
def test_the_size_of_an_arm_is_as_certain_as_the_plate_that_it_visited(tmp_path):
    declared, exact = [], []
    for seed in range(2):
        arm, dataset = _visited(tmp_path / str(seed), seed, 3)
        for scores, cell in (
            (declared, dataset),
            (exact, replace(dataset, scanner=replace(dataset.scanner, place_sigma_mm=None))),
        ):
            off, sigma = _scale(arm, calibrate(cell), np.random.default_rng(1))
            scores.append(off / sigma)
    assert np.sqrt(np.mean(np.square(declared))) < 2.3  # 0.5 % of two honest scores
    assert np.sqrt(np.mean(np.square(exact))) > 3.0  # taken as exact, the plate's error is in no sigma


def test_points_that_are_no_known_places_are_refused(dataset):
    points = replace(dataset.points, xyz_mm=dataset.points.xyz_mm + np.arange(len(dataset.points))[:, None])
    with pytest.raises(DatasetError, match="leave it out"):
        calibrate(replace(dataset, points=points))
