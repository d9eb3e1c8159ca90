"""Fits of points that leave the arm's size open (ball in a socket, tip on a plane, bar): the prior keeps the size."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate, check, diagnose
from calib.calibration.plausibility import implausibility_reason, too_good
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.folder import load_dataset
from calib.options import FitOptions
from calib.present.over_time.checks import item_sentence
from tests.support import ROOT
from tests.support.arms import dataset_of, elementary_points, jang_arm, park_arm, perturbed
from tests.support.constrained_arms import accepted_collapse

SOCKETS = ROOT.parent / "shared" / "data" / "mukca_panda_7"


def in_one_socket(sigma_mm: float | None, *, poses: int = 24) -> Dataset:
    """Dataset of an arm whose ball stays in one socket, joint values by Newton's method on elementary transforms."""
    rng = np.random.default_rng(3)
    nominal = park_arm("panda")
    true = perturbed(nominal, rng)
    seat_mm = elementary_points(true, np.full((1, 7), 0.4))[0]
    q = np.empty((poses, 7))
    for row in q:
        row[:] = rng.uniform(-0.4, 1.2, 7)
        wanted_mm = seat_mm + 0.1 * rng.normal(size=3)
        for _ in range(50):
            steps = np.vstack([row, row + 1e-6 * np.eye(7)])
            at = elementary_points(true, steps)
            columns = (at[1:] - at[0]).T / 1e-6
            row -= np.clip(np.linalg.pinv(columns, rcond=1e-3) @ (at[0] - wanted_mm), -0.3, 0.3)
    ids = tuple(f"p{k:02d}" for k in range(poses))
    role = np.array(["reference", *["train"] * (poses - 1)])
    table = Poses(ids, role, q, np.full(poses, ""), tuple(f"{i}.ply" for i in ids))
    points = Points(np.arange(poses), np.zeros((poses, 3)), np.full(poses, "jig"))
    return Dataset("socket", nominal, table, points, Scanner(sigma_mm))


@pytest.mark.slow
@pytest.mark.parametrize("sigma_mm", [0.1, None])
def test_a_ball_in_a_socket_does_not_shrink_the_arm(sigma_mm: float | None) -> None:
    dataset = in_one_socket(sigma_mm)
    fitted = calibrate(dataset)
    lengths = np.abs(fitted.robot.table[:, [0, 2]]).sum() / np.abs(dataset.robot.table[:, [0, 2]]).sum()
    assert 0.97 < lengths < 1.03
    assert np.max(np.abs(fitted.fit.x) / fitted.model.scales) < 8.0
    assert not implausibility_reason(fitted)
    free = calibrate(dataset, FitOptions(prior=False))  # what the prior keeps away
    assert np.abs(free.robot.table[:, [0, 2]]).sum() < 0.5 * np.abs(dataset.robot.table[:, [0, 2]]).sum()
    assert "times its tolerance" in implausibility_reason(free)


@pytest.mark.slow
def test_exact_data_are_still_met_exactly_and_called_too_good() -> None:
    rng = np.random.default_rng(5)
    robot = jang_arm()
    dataset = dataset_of(robot, perturbed(robot, rng), rng, test=13)
    fitted = calibrate(dataset)
    assert fitted.sigma_mm < 1e-9
    assert "that good" in too_good(fitted)
    checked = check(dataset)
    assert not checked.passed
    assert any("that good" in item_sentence(item) for item in checked.failed)


def test_noise_as_declared_is_not_too_good() -> None:
    rng = np.random.default_rng(6)
    robot = jang_arm()
    for sigma_mm in (0.05, 0.1):  # as it is, and declared twice too large
        dataset = dataset_of(robot, perturbed(robot, rng), rng, noise_mm=0.05, sigma_mm=sigma_mm)
        assert not too_good(calibrate(dataset))


@pytest.mark.slow
@pytest.mark.skipif(not SOCKETS.exists(), reason="the measured arm is not here")
def test_a_measured_arm_in_sockets_keeps_its_links() -> None:
    dataset = load_dataset(SOCKETS)
    last = diagnose(dataset).calibration
    assert last.sigma_mm > 0.05
    assert np.max(np.abs(last.robot.table[:, [0, 2]] - dataset.robot.table[:, [0, 2]])) < 10.0
    test = last.after.test
    assert test.rmse_mm == pytest.approx(0.30, abs=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [4, 6, 33, 53])
def test_no_arm_that_lost_its_size_is_accepted(number: int) -> None:
    assert accepted_collapse(number, 18) == ""
