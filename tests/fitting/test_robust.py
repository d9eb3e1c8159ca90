"""Robust weights of full poses: who loses them, where the fit stays, and what they cost where nothing is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.calibration.calibrate import calibrate
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.distributions import chi2_ppf
from calib.fitting.fit import Fit
from calib.fitting.model import Model, geometric_model
from calib.fitting.observations import Observations
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.robust import point_norms, rows_of_points, solve_robustly, tukey_weights, weighted
from calib.fitting.trust_region import solve
from calib.options import FitOptions
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main
from tests.support.fit_cases import SIGMA_RAD, full_poses, seated, with_pose_covariances

POSES = 50


def arm(seed: int, poses: int = POSES) -> tuple[Dataset, np.ndarray]:
    """Full poses of an arm, the jig sitting anyhow, and its true corrections in the order of the parameters."""
    made = simulate_dataset(
        builtin_robot("rb5"),
        rng=np.random.default_rng(seed),
        poses=poses,
        orientation_sigma_rad=SIGMA_RAD,
    )
    dataset = seated(made.dataset, Rotation.random(random_state=seed).as_matrix())
    return dataset, (made.truth.robot.table - dataset.robot.table).ravel()


def spoiled(dataset: Dataset, point: int, *, turn: Rotation | None = None, shift_mm: float = 0.0) -> Dataset:
    """One measured pose turned about the scanner's axes, or shifted."""
    points = dataset.points
    assert points is not None
    assert points.orientations is not None
    xyz_mm, turned = points.xyz_mm.copy(), points.orientations.scanner_R_jig.copy()
    xyz_mm[point] += shift_mm * np.array([0.6, -0.8, 0.0])
    if turn is not None:
        turned[point] = turn.as_matrix() @ turned[point]
    orientations = replace(points.orientations, scanner_R_jig=turned)
    return dataset.with_points(replace(points, xyz_mm=xyz_mm, orientations=orientations))


def robust(dataset: Dataset, *, prior: bool = True) -> tuple[Fit, np.ndarray]:
    model = geometric_model(dataset.robot)
    return solve_robustly(
        lambda seen: make_residuals("pose", model, seen), Observations.of(dataset), prior=prior
    )


def plain(dataset: Dataset) -> Fit:
    return solve(make_residuals("pose", geometric_model(dataset.robot), Observations.of(dataset)))


def squared(model: Model, fit: Fit, true: np.ndarray) -> float:
    """The error in units of the fit's own covariance, what manufacture tolerates being its prior."""
    off = (fit.x - true) / model.scales
    return float(off @ np.linalg.solve(fit.covariance / np.outer(model.scales, model.scales), off))


def named_anew(dataset: Dataset, point: int) -> Rotation:
    """The turn that a wrong name of the three faces is: by a third of a turn about the jig's diagonal."""
    assert dataset.points is not None
    assert dataset.points.orientations is not None
    jig = dataset.points.orientations.scanner_R_jig[point]
    return Rotation.from_rotvec(jig @ np.full(3, 2.0 * np.pi / 3.0 / np.sqrt(3.0)))


@pytest.mark.parametrize(
    ("what", "seed"),
    [("tilted a little", 0), ("tilted", 1), ("wrong name", 2), ("upside down", 4), ("shifted", 0)],
)
def test_one_wrong_pose_loses_its_weight_and_the_arm_stays_true(what: str, seed: int) -> None:
    dataset, true = arm(seed)
    model = geometric_model(dataset.robot)
    point = int(np.flatnonzero(~dataset.poses.is_test)[7 + 5 * seed])
    about = Rotation.random(random_state=seed).as_matrix()[0]
    wrong = {
        "tilted a little": lambda: spoiled(dataset, point, turn=Rotation.from_rotvec(15 * SIGMA_RAD * about)),
        "tilted": lambda: spoiled(dataset, point, turn=Rotation.from_rotvec(0.05 * about)),
        "wrong name": lambda: spoiled(dataset, point, turn=named_anew(dataset, point)),
        "upside down": lambda: spoiled(dataset, point, turn=Rotation.from_rotvec((np.pi - 1e-6) * about)),
        "shifted": lambda: spoiled(dataset, point, shift_mm=2.0),
    }[what]()
    fit, weights = robust(wrong)
    row = int(np.flatnonzero(Observations.of(wrong).points.pose == point)[0])
    assert weights[row] < 1e-5
    assert np.sum(weights < 0.05) <= 2  # and hardly another
    # 21 parameters are known to the data; those held by the prior add next to nothing.
    assert squared(model, fit, true) < chi2_ppf(0.999, 24)
    assert 0.85 < fit.noise < 1.15  # the wrong pose adds nothing to it, however wrong it is
    if what != "tilted a little":
        assert plain(wrong).noise > 2.0


@pytest.mark.slow
def test_a_third_of_all_names_wrong_is_seen_too() -> None:
    dataset, true = arm(3)
    wrong = dataset
    for point in range(0, POSES, 3):
        wrong = spoiled(wrong, point, turn=named_anew(dataset, point))
    fit, weights = robust(wrong)
    bad = Observations.of(wrong).points.pose % 3 == 0
    assert np.all(weights[bad] < 1e-5)
    assert np.median(weights[~bad]) > 0.5
    assert squared(geometric_model(dataset.robot), fit, true) < chi2_ppf(0.999, 24)


@pytest.mark.slow
def test_where_nothing_is_wrong_the_weights_cost_five_per_cent() -> None:
    """An estimate of 95 % efficiency differs from the best by 1 / 0.95 - 1 = 0.053 of a parameter's variance."""
    apart, noise, sigma, off = [], [], [], []
    for seed in range(4):
        dataset, true = arm(seed, poses=150)
        model = geometric_model(dataset.robot)
        best, (fit, _) = plain(dataset), robust(dataset)
        apart.append(squared(model, replace(best, x=fit.x), best.x) / best.known)
        noise.append(fit.noise / best.noise)
        known = np.sqrt(np.diag(best.covariance)) < 0.1 * model.scales
        sigma.append(np.median(fit.sigma[known] / best.sigma[known]))
        off.append(squared(model, fit, true))
    assert np.mean(apart) < 0.15
    assert np.mean(noise) == pytest.approx(1.0, abs=0.04)
    assert np.mean(sigma) == pytest.approx(1.0 / np.sqrt(0.95), abs=0.04)
    assert np.mean(off) == pytest.approx(21.0, abs=4.0 * np.sqrt(2.0 * 21.0 / 4.0))


def test_without_a_prior_the_known_directions_are_as_uncertain() -> None:
    dataset, _ = arm(5, poses=150)
    model = geometric_model(dataset.robot)
    fits = [robust(dataset, prior=prior)[0] for prior in (True, False)]
    held, free = (fit.covariance for fit in fits)
    assert np.all(
        fits[0].sigma < 1.001 * model.scales
    )  # the prior's own sigma does not grow with the weights
    values, vectors = np.linalg.eigh(held / np.outer(model.scales, model.scales))
    known = vectors[:, values < 1e-3]
    variance = [np.diag(known.T @ (c / np.outer(model.scales, model.scales)) @ known) for c in (held, free)]
    assert known.shape[1] >= 19
    np.testing.assert_allclose(variance[1], variance[0], rtol=0.05)


@pytest.mark.parametrize("rows", [3, 6])
def test_the_constants_give_the_efficiency_that_they_promise(rows: int) -> None:
    """Asymptotic variance of a location estimate, E[psi^2] / d over E[div psi / d]^2, by drawing."""
    draws = np.random.default_rng(rows).normal(size=(400_000, rows))
    norm = np.linalg.norm(draws, axis=1)
    numbers = np.full(len(norm), rows)
    step = 1e-4
    # The median of all sets the scale, so the whole set grows by the step and only the weights' change is read off.
    scale = np.median(norm)
    table = np.linspace(0.0, 10.0, 4001)
    padded = np.concatenate([table, np.full(2 * len(table), scale)])  # the median stays where it was
    weight = tukey_weights(padded, np.full(len(padded), rows))[: len(table)]
    np.testing.assert_allclose(np.interp(norm, table, weight), tukey_weights(norm, numbers), atol=1e-4)
    w, more = np.interp(norm, table, weight), np.interp(norm + step, table, weight)
    square = np.mean((w * norm) ** 2) / rows
    slope = np.mean(w + norm * (more - w) / step / rows)
    assert slope**2 / square == pytest.approx(0.95, abs=0.004)


@pytest.mark.slow
def test_points_without_orientation_are_weighed_by_their_three_rows() -> None:
    dataset = with_pose_covariances(full_poses(21, poses=60), np.random.default_rng(2))
    point = 10  # has a place only
    fit, weights = robust(spoiled(dataset, point, shift_mm=5.0))
    seen = Observations.of(dataset)
    row = int(np.flatnonzero(seen.points.pose == point)[0])
    residuals = make_residuals("pose", geometric_model(dataset.robot), seen)
    rows = rows_of_points(residuals, seen)
    assert rows[row] == 3
    assert set(rows.tolist()) == {3, 6}
    assert weights[row] < 1e-5
    assert np.median(weights[rows == 3]) > 0.5
    assert np.median(weights[rows == 6]) > 0.5
    norms = point_norms(residuals.residual(fit.x), rows)
    assert norms**2 @ np.ones(len(rows)) == pytest.approx(float(np.sum(residuals.residual(fit.x) ** 2)))


def test_a_weight_is_one_of_all_six_coordinates() -> None:
    """The same weight for all only makes the residual shorter: covariances and what point and turn share go along."""
    dataset = with_pose_covariances(full_poses(22), np.random.default_rng(3))
    seen = Observations.of(dataset)
    model = geometric_model(dataset.robot)
    x = 0.2 * model.scales
    whole = make_residuals("pose", model, seen).residual(x)
    quarter = make_residuals("pose", model, weighted(seen, np.full(len(seen.points), 0.25))).residual(x)
    np.testing.assert_allclose(quarter, 0.5 * whole, atol=1e-6 * np.abs(whole).max())


@pytest.mark.slow
def test_the_command_takes_robust_poses_and_names_those_that_count_less(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset, _ = arm(6)
    point = int(np.flatnonzero(~dataset.poses.is_test)[5])
    wrong = spoiled(dataset, point, turn=Rotation.from_rotvec([0.03, 0.0, 0.0]))
    write_dataset(wrong, tmp_path / "wrong")
    assert main(["calibrate", str(tmp_path / "wrong"), "--residual", "pose", "--robust", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    (warning,) = (w for w in document["warnings"] if "count less than half" in w)
    assert dataset.poses.ids[point] in warning
    by_library = calibrate(wrong, FitOptions("pose", robust=True))
    assert document["sigma_mm"] == pytest.approx(by_library.sigma_mm, rel=1e-4)
    # The test poses tell that the arm is as good as without the wrong pose; the plain fit is not.
    best, bad = (
        calibrate(dataset, FitOptions("pose")).after.test,
        calibrate(wrong, FitOptions("pose")).after.test,
    )
    assert best is not None
    assert bad is not None
    assert document["test"]["rmse_mm"] < 1.1 * best.rmse_mm < bad.rmse_mm
