"""Calibration as a whole: errors before and after, refusals, and the numbers of Jang's tables."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, check, frames, redundancy
from calib.dataset.dataset import Dataset, Points
from calib.dataset.files.folder import load_dataset
from calib.dataset.repeats import repeats_of
from calib.effects.catalogue import family_of
from calib.errors import FitError
from calib.fitting.scanner_frame import fit_scanner_frame
from calib.options import FitOptions
from calib.present.fit.calibration import calibration_warnings
from calib.simulation.simulate import simulate_dataset
from tests.support import SHARED_DATA
from tests.support.arms import (
    REFERENCE,
    dataset_of,
    elementary_points,
    jang_arm,
    park_arm,
    perturbed,
    random_transform,
)
from tests.support.changed import with_poses


def simulated(seed: int = 0, **more: object) -> Dataset:
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    options: dict = {"poses": 64, "test": 13, "noise_mm": 0.02, "sigma_mm": 0.02} | more
    return dataset_of(robot, perturbed(robot, rng), rng, base_T_scanner=random_transform(rng), **options)


@pytest.mark.parametrize("residual", ["position", "distance"])
def test_the_held_out_error_falls_to_the_noise(residual: str) -> None:
    result = calibrate(simulated(), FitOptions(residual))
    assert result.before.test.rmse_mm > 1.0
    # 0.02 mm an axis is 0.035 mm in 3D; the fit's own uncertainty comes on top.
    assert result.after.test.rmse_mm < {"position": 0.06, "distance": 0.12}[residual]
    assert result.sigma_mm == pytest.approx(0.02, rel=0.35)
    assert result.iteration_errors[0].train_rmse_mm == pytest.approx(result.before.train.rmse_mm)  # type: ignore[union-attr]
    assert result.iteration_errors[-1].test_rmse_mm == pytest.approx(result.after.test.rmse_mm)


def test_the_calibrated_table_reaches_places_it_never_saw() -> None:
    rng = np.random.default_rng(3)
    robot = park_arm("panda")
    true = perturbed(robot, rng)
    result = calibrate(dataset_of(robot, true, rng, noise_mm=0.0))
    q = rng.uniform(-np.pi, np.pi, (100, 7))
    # The base frame is not known, so shapes are compared.
    found, truth = elementary_points(result.robot, q), elementary_points(true, q)
    fitted = frames.apply(frames.best_fit_transform(found, truth), found)
    np.testing.assert_allclose(fitted, truth, atol=1e-5)


def test_test_poses_have_no_say_in_the_fit() -> None:
    dataset = simulated()
    points = dataset.points
    shifted = points.xyz_mm + np.where(dataset.poses.is_test[points.pose], 5.0, 0.0)[:, None]
    other = calibrate(dataset.with_points(Points(points.pose, shifted, points.target)))
    np.testing.assert_array_equal(other.fit.x, calibrate(dataset).fit.x)
    assert other.after.test.rmse_mm > 5.0


def test_figures_by_hand() -> None:
    """RMSE, maximum and mean of 3D and distance errors equal those from their definitions."""
    dataset = simulated(noise_mm=0.3)
    result = calibrate(dataset, FitOptions("distance"))
    measured = dataset.points.xyz_mm
    base = elementary_points(result.robot, dataset.poses.q)
    train = ~dataset.poses.is_test
    placed = frames.apply(frames.best_fit_transform(base[train], measured[train]), base)
    error = np.linalg.norm(placed - measured, axis=1)
    length = np.abs(np.linalg.norm(base - base[0], axis=1) - np.linalg.norm(measured - measured[0], axis=1))
    for figures, of in ((result.after.train, train), (result.after.test, ~train)):
        assert figures.rmse_mm == pytest.approx(np.sqrt(np.mean(error[of] ** 2)), rel=1e-9)
        assert figures.max_mm == pytest.approx(error[of].max(), rel=1e-9)
        assert figures.mean_mm == pytest.approx(error[of].mean(), rel=1e-9)
        distances = length[of & (np.arange(len(length)) > 0)]
        assert figures.distance_max_mm == pytest.approx(distances.max(), rel=1e-9)
        assert figures.distance_mean_mm == pytest.approx(distances.mean(), rel=1e-9)


def test_setups_have_frames_of_their_own_and_one_without_training_says_so() -> None:
    rng = np.random.default_rng(1)
    dataset = simulated()
    poses = dataset.poses
    setup = np.where(np.arange(64) % 2 == 0, "left", "right")
    setup[poses.is_test] = "far"
    xyz = dataset.points.xyz_mm.copy()
    for name in ("left", "right", "far"):
        xyz[setup == name] = frames.apply(random_transform(rng), xyz[setup == name])
    split = replace(dataset, poses=replace(poses, setup=setup)).with_points(
        Points(dataset.points.pose, xyz, dataset.points.target)
    )
    for residual in ("position", "distance"):
        result = calibrate(split, FitOptions(residual))
        assert result.after.train.rmse_mm < 0.1
        assert result.after.test.rmse_mm < 0.2
        assert any("'far'" in note for note in calibration_warnings(result))


def test_covariances_weigh_the_points() -> None:
    """For points noisy along one axis, full covariances give a better frame than none."""
    rng = np.random.default_rng(0)
    base = rng.normal(size=(40, 3)) * 300
    truth = random_transform(rng)
    axis = rng.normal(size=(40, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    covariance = 0.01**2 * np.eye(3) + 1.0**2 * axis[:, :, None] * axis[:, None, :]
    errors: dict[str, list[float]] = {"with": [], "without": []}
    for _ in range(30):
        noise = np.einsum("mij,mj->mi", np.linalg.cholesky(covariance), rng.normal(size=(40, 3)))
        scanner = frames.apply(truth, base) + noise
        for name, used in (("with", covariance), ("without", np.broadcast_to(np.eye(3), (40, 3, 3)))):
            found = fit_scanner_frame(base, scanner, used)
            errors[name].append(float(np.mean((frames.apply(found, base) - frames.apply(truth, base)) ** 2)))
    assert np.mean(errors["with"]) < 0.05 * np.mean(errors["without"])


def test_a_dataset_without_points_is_refused() -> None:
    with pytest.raises(FitError, match="no measured points"):
        calibrate(replace(simulated(), points=None))


def test_all_poses_alike_are_refused() -> None:
    dataset = simulated()
    same = with_poses(dataset, q=np.zeros_like(dataset.poses.q))
    noise = np.random.default_rng(0).normal(size=(64, 3)) * 0.05
    stands = same.with_points(Points(same.points.pose, noise + np.array([1.0, 2.0, 3.0]), same.points.target))
    verdict = check(stands)
    assert not any(item.name == "fit" and item.passed for item in verdict.items)
    with pytest.raises(FitError, match="parameters"):
        calibrate(stands)
    with pytest.raises(FitError, match="distances between different places"):
        redundancy(stands, residual="distance")


def test_a_fit_that_made_it_worse_is_not_exported() -> None:
    good = calibrate(simulated())
    good.require_improvement()
    worse = replace(good, before=good.after, after=good.before)
    with pytest.raises(FitError, match="got worse"):
        worse.require_improvement()
    worse.require_improvement(force=True)
    with pytest.raises(FitError, match="did not converge"):
        replace(good, fit=replace(good.fit, converged=False, reason="tired")).require_improvement()


def test_redundancy_of_distances_loses_what_turns_the_base() -> None:
    dataset = simulated()
    position, distance = redundancy(dataset), redundancy(dataset, residual="distance")
    assert position.rank == 21
    assert distance.rank == 19
    assert {"d1", "theta1", "beta1"} <= set(distance.no_influence)
    assert not {"d1", "theta1"} & set(position.no_influence)


def test_jangs_table_3_explains_his_arm() -> None:
    """A fit from Jang's Table 2 to data of the arm in Table 3 finds an arm that moves alike."""
    rng = np.random.default_rng(0)
    true = jang_arm("jang_table3_rb5_calibrated.csv")
    dataset = dataset_of(jang_arm(), true, rng, test=13, noise_mm=0.0)
    for residual in ("position", "distance"):
        result = calibrate(dataset, FitOptions(residual))
        assert result.before.test.max_mm > 3.0
        assert result.after.test.max_mm < 1e-4


def test_table_1_recomputed_from_its_rows() -> None:
    """Position errors of 0.026-0.095 mm and deviations of 0.03-0.09 mm per axis, as in the paper."""
    with (REFERENCE / "jang_table1_repeats.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    places = {}
    for name in ("P1", "P2", "P3", "P4"):
        xyz = {r["cycle"]: [float(r[f"{a}_mm"]) for a in "xyz"] for r in rows if r["point"] == name}
        reference = xyz.pop("reference")
        places[name] = repeats_of(name, list(xyz.values()), reference)
    offsets = [p.offset_mm for p in places.values()]
    assert round(min(offsets), 3) == 0.026  # type: ignore[type-var,arg-type]
    assert round(max(offsets), 3) == 0.095  # type: ignore[type-var,arg-type]
    deviations = np.array([p.sigma_mm for p in places.values()])
    assert round(float(deviations.min()), 2) == 0.03
    assert round(float(deviations.max()), 2) == 0.09


@pytest.mark.skipif(not SHARED_DATA.is_dir(), reason="the real measurements are not part of the project")
def test_a_real_arm_reaches_the_floor_of_an_independent_fit() -> None:
    """Others are among the sample datasets."""
    result = calibrate(load_dataset(SHARED_DATA / "mukca_panda_1"))
    assert result.after.test.rmse_mm <= 0.85


@pytest.mark.slow
@pytest.mark.parametrize("robot_name", ["rb5", "panda"])
def test_a_fit_that_goes_on_from_another_ends_where_it_would_have_ended(robot_name: str) -> None:
    dataset = simulate_dataset(
        robot_name,
        rng=5,
        effects=("joint_compliance",),
        visible_sigmas=3.0,
    ).dataset
    members = family_of(dataset, "joint_compliance").members
    plain = calibrate(dataset)
    alone, on = calibrate(dataset, effects=members), calibrate(dataset, effects=members, start=plain)
    np.testing.assert_allclose(on.fit.x, alone.fit.x, atol=0.0, rtol=1e-9)
    np.testing.assert_array_equal(
        [s.train_rmse_mm for s in on.iteration_errors], [s.train_rmse_mm for s in alone.iteration_errors]
    )
    assert on.fit.rank == alone.fit.rank
    assert on.before.train.rmse_mm == plain.before.train.rmse_mm
    # Added in two rounds, or one less again: the loads come from other links, which differ by what effects moved.
    wobbling = family_of(dataset, "transmission_error").members
    both = calibrate(dataset, effects=(*members, *wobbling))
    for again in (
        calibrate(dataset, effects=(*members, *wobbling), start=on),
        calibrate(dataset, effects=(*wobbling, *members), start=both),
    ):
        values = dict(zip([p.name for p in again.fit.parameters], again.fit.x, strict=True))
        off = [abs(values[p.name] - v) for p, v in zip(both.fit.parameters, both.fit.x, strict=True)]
        assert np.max(np.array(off) / both.fit.sigma) < 0.05
    less = calibrate(dataset, start=both)
    assert np.max(np.abs(less.fit.x - plain.fit.x) / plain.fit.sigma) < 0.01
