"""Robust fits: outlying poses are left out, the fit stays near the true arm, and clean data give the plain fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import calibrate, diagnose
from calib.calibration.plausibility import fit_without_outliers
from calib.calibration.pose_errors import pose_errors_of
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.fitting.fit import Fit
from calib.fitting.model import Model, geometric_model
from calib.fitting.observations import Observations, weighted
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.robust import point_norms, rows_of_points
from calib.options import FitOptions
from calib.present.fit.calibration import calibration_warnings, outlier_hint
from calib.simulation.simulate import simulate_dataset
from calib.statistics import chi2_ppf
from tests.support import ROOT
from tests.support.changed import with_poses, with_xyz
from tests.support.fit_cases import SIGMA_RAD, full_poses, seated, with_pose_covariances
from tests.support.sweeps import sweep

POSES = 50
SAMPLES = ROOT / "sample_data"


def arm(seed: int, poses: int = POSES) -> tuple[Dataset, np.ndarray]:
    """Dataset of full poses with a random hand-eye rotation, and the true corrections in the parameters' order."""
    made = simulate_dataset(
        "rb5",
        rng=seed,
        poses=poses,
        orientation_sigma_rad=SIGMA_RAD,
    )
    dataset = seated(made.dataset, Rotation.random(random_state=seed).as_matrix())
    return dataset, (made.truth.robot.table - dataset.robot.table).ravel()


def spoiled(dataset: Dataset, point: int, *, turn: Rotation | None = None, shift_mm: float = 0.0) -> Dataset:
    """The dataset with one measured pose turned about the scanner's axes, or shifted."""
    points = dataset.points
    xyz_mm, turned = points.xyz_mm.copy(), points.orientations.scanner_R_jig.copy()
    xyz_mm[point] += shift_mm * np.array([0.6, -0.8, 0.0])
    if turn is not None:
        turned[point] = turn.as_matrix() @ turned[point]
    orientations = replace(points.orientations, scanner_R_jig=turned)
    return dataset.with_points(replace(points, xyz_mm=xyz_mm, orientations=orientations))


def robust(dataset: Dataset) -> Calibration:
    return calibrate(dataset, FitOptions("pose", robust=True))


def plain(dataset: Dataset) -> Calibration:
    return calibrate(dataset, FitOptions("pose"))


def ids(dataset: Dataset, points: np.ndarray | list[int]) -> set[str]:
    return {dataset.poses.ids[i] for i in points}


def squared(model: Model, fit: Fit, true: np.ndarray) -> float:
    """Squared Mahalanobis distance of a fit from the true corrections, by the fit's covariance."""
    off = (fit.x - true) / model.scales
    return float(off @ np.linalg.solve(fit.covariance / np.outer(model.scales, model.scales), off))


def named_anew(dataset: Dataset, point: int) -> Rotation:
    """Rotation by wrong labels of the three faces: a third of a turn about the jig's diagonal."""
    jig = dataset.points.orientations.scanner_R_jig[point]
    return Rotation.from_rotvec(jig @ np.full(3, 2.0 * np.pi / 3.0 / np.sqrt(3.0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "seed"),
    [("tilted a little", 0), ("tilted", 1), ("wrong name", 2), ("upside down", 4), ("shifted", 0)],
)
def test_one_wrong_pose_is_left_out_and_the_arm_stays_true(what: str, seed: int) -> None:
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
    found = robust(wrong)
    assert set(found.outliers) == ids(wrong, [point])
    # 21 parameters are known to the data; those held by the prior add next to nothing.
    assert squared(model, found.fit, true) < chi2_ppf(0.999, 24)
    assert 0.85 < found.fit.reduced_chi < 1.15  # the wrong pose adds nothing to it, however wrong it is
    if what != "tilted a little":
        assert plain(wrong).fit.reduced_chi > 2.0


@pytest.mark.slow
def test_a_third_of_all_names_wrong_is_seen_too() -> None:
    dataset, true = arm(3)
    wrong = dataset
    for point in range(0, POSES, 3):
        wrong = spoiled(wrong, point, turn=named_anew(dataset, point))
    found = robust(wrong)
    wrongly_named = [i for i in range(0, POSES, 3) if not wrong.poses.is_test[i]]
    assert set(found.outliers) == ids(wrong, wrongly_named)
    assert squared(geometric_model(dataset.robot), found.fit, true) < chi2_ppf(0.999, 24)


@pytest.mark.slow
def test_where_nothing_is_wrong_the_fit_is_the_plain_one() -> None:
    for seed in range(3):
        dataset, _ = arm(seed)
        found = robust(dataset)
        assert found.outliers == ()
        np.testing.assert_array_equal(found.fit.x, plain(dataset).fit.x)


@pytest.mark.slow
def test_points_without_orientation_are_judged_by_their_three_rows() -> None:
    dataset = with_pose_covariances(full_poses(21, poses=60), np.random.default_rng(2))
    point = 10  # has a place only
    found = robust(spoiled(dataset, point, shift_mm=5.0))
    seen = Observations.of(dataset)
    residuals = make_residuals("pose", geometric_model(dataset.robot), seen)
    rows = rows_of_points(residuals, seen)
    assert rows[int(np.flatnonzero(seen.points.pose == point)[0])] == 3
    assert set(rows.tolist()) == {3, 6}
    assert set(found.outliers) == ids(dataset, [point])
    norms = point_norms(residuals.residual(found.fit.x), rows)
    assert norms**2 @ np.ones(len(rows)) == pytest.approx(float(np.sum(residuals.residual(found.fit.x) ** 2)))


def test_a_weight_is_one_of_all_six_coordinates() -> None:
    """A common weight only scales the residual, including the covariance between point and orientation."""
    dataset = with_pose_covariances(full_poses(22), np.random.default_rng(3))
    seen = Observations.of(dataset)
    model = geometric_model(dataset.robot)
    x = 0.2 * model.scales
    whole = make_residuals("pose", model, seen).residual(x)
    quarter = make_residuals("pose", model, weighted(seen, np.full(len(seen.points), 0.25))).residual(x)
    np.testing.assert_allclose(quarter, 0.5 * whole, atol=1e-6 * np.abs(whole).max())


# ---- positions ------------------------------------------------------------------------------------------------------


def measured_arm(seed: int, poses: int, effects: Sequence[str] = (), robot: str = "panda") -> Dataset:
    """Simulated dataset with some training and 40 test poses; the effects are missing from the fitted model."""
    made = simulate_dataset(robot, rng=seed, poses=poses + 40, effects=effects)
    role = np.array(["reference"] + ["train"] * (poses - 1) + ["test"] * 40)
    return with_poses(made.dataset, role=role)


def moved(dataset: Dataset, points: Sequence[int], off_mm: float) -> Dataset:
    """The dataset with some points moved by a distance, each in its own direction."""
    away = np.random.default_rng(len(points)).normal(size=(len(points), 3))
    xyz_mm = dataset.points.xyz_mm.copy()
    xyz_mm[list(points)] += off_mm * away / np.linalg.norm(away, axis=1, keepdims=True)
    return with_xyz(dataset, xyz_mm)


def without(dataset: Dataset, points: Sequence[int]) -> Dataset:
    return dataset.with_points(dataset.points.select(~np.isin(np.arange(len(dataset.points)), points)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("poses", "wrong", "off_mm", "effects"),
    sweep(
        [
            (poses, wrong, off_mm, effects)
            for poses, wrong in ((25, (7,)), (25, (0, 8, 19)), (64, (3, 30)))
            for off_mm in (5.0, 50.0, 500.0)
            for effects in ((), ("joint_compliance", "transmission_error"))
        ],
        every_run=[
            (25, (7,), 50.0, ()),
            (25, (7,), 50.0, ("joint_compliance", "transmission_error")),
            (25, (0, 8, 19), 5.0, ()),
            (25, (0, 8, 19), 500.0, ("joint_compliance", "transmission_error")),
            (64, (3, 30), 5.0, ("joint_compliance", "transmission_error")),
            (64, (3, 30), 500.0, ()),
        ],
    ),
)
def test_wrong_points_leave_no_trace(
    poses: int, wrong: tuple[int, ...], off_mm: float, effects: tuple[str, ...]
) -> None:
    """With 24 good poses of seven joints and one off by 50 mm, fit and test error are those of the 24."""
    dataset = measured_arm(len(wrong) + poses, poses, effects)
    found = calibrate(moved(dataset, wrong, off_mm), FitOptions(robust=True))
    good = calibrate(without(dataset, wrong))
    assert set(found.outliers) == ids(dataset, wrong)
    np.testing.assert_array_equal(found.fit.x, good.fit.x)
    assert found.after.test == good.after.test
    assert found.after.train == good.after.train
    assert found.sigma_mm == good.sigma_mm
    (warning,) = (w for w in calibration_warnings(found) if "out of all others" in w)
    assert all(pose_id in warning for pose_id in ids(dataset, wrong))


@pytest.mark.parametrize(
    "effects",
    [(), ("joint_compliance",), ("backlash", "base_compliance"), ("transmission_error", "joint_compliance")],
)
@pytest.mark.thorough
def test_what_the_model_lacks_is_no_outlier(effects: tuple[str, ...]) -> None:
    left_out = []
    for seed in range(6):
        dataset = measured_arm(seed, 25 if seed % 2 else 64, effects, "rb5" if seed % 3 else "panda")
        found = calibrate(dataset, FitOptions(robust=True))
        left_out.append(len(found.outliers))
        if not found.outliers:
            np.testing.assert_array_equal(found.fit.x, calibrate(dataset).fit.x)
    assert sum(left_out) == 0, left_out


@pytest.mark.slow
@pytest.mark.parametrize("count", [50, 100, 200])
def test_a_real_arm_is_not_harmed(count: int) -> None:
    """A real arm's unmodelled joint curves raise the robust fit's test error by less than 1 %."""
    dataset = load_dataset(SAMPLES / "ur10_ipa")
    training = np.flatnonzero(~dataset.poses.is_test)
    chosen = np.random.default_rng(2).choice(training, count, replace=False)
    kept = dataset.poses.is_test | np.isin(np.arange(len(dataset.poses)), chosen)
    dataset = dataset.with_points(dataset.points.select(kept[dataset.points.pose]))
    found, best = calibrate(dataset, FitOptions(robust=True)).after.test, calibrate(dataset).after.test
    assert found.rmse_mm < 1.01 * best.rmse_mm


@pytest.mark.slow
def test_heavy_tails_cost_nothing_and_gross_errors_among_them_go() -> None:
    rng = np.random.default_rng(5)
    dataset = measured_arm(3, 64)
    noisy = replace(dataset.points, xyz_mm=dataset.points.xyz_mm + 0.05 * rng.standard_t(3, (104, 3)))
    dataset = dataset.with_points(noisy)
    robustly, plainly = calibrate(dataset, FitOptions(robust=True)), calibrate(dataset)
    assert len(robustly.outliers) <= 3
    assert robustly.after.test.rmse_mm < 1.02 * plainly.after.test.rmse_mm
    assert ids(dataset, [9, 40]) <= set(calibrate(moved(dataset, [9, 40], 20.0), FitOptions(robust=True)).outliers)


def test_a_pose_that_an_effect_explains_comes_back_with_it() -> None:
    """A refit with an effect takes back the poses that the effect explains."""
    dataset = measured_arm(1, 40)
    spoilt = moved(dataset, [5], 20.0)
    first = calibrate(spoilt, FitOptions(robust=True))
    assert set(first.outliers) == ids(dataset, [5])
    again = calibrate(dataset, FitOptions(robust=True), start=first)
    assert again.outliers == ()


@pytest.mark.slow
def test_an_outlier_counts_in_no_figure_of_a_fit_and_stays_in_the_table_of_errors() -> None:
    dataset = moved(measured_arm(4, 40), [11], 30.0)
    found = calibrate(dataset, FitOptions(robust=True))
    assert found.after.train.points == 39
    errors = pose_errors_of(found)
    assert errors.worst(1) == (dataset.poses.ids[11],)
    assert errors.error_length_mm[11] == pytest.approx(30.0, abs=1.0)
    assert all(step.train_rmse_mm < 30.0 for step in found.iteration_errors[1:])


@pytest.mark.slow
def test_a_diagnosis_by_robust_fits_tells_the_poses_that_they_left_out() -> None:
    dataset = moved(measured_arm(3, 25), [6], 50.0)
    found = diagnose(dataset, FitOptions(robust=True))
    assert found.verdict == "outliers"
    assert found.residual_tests.outlier_poses == (dataset.poses.ids[6],)
    assert f"stands out: {dataset.poses.ids[6]}" in found.summary()


@pytest.mark.slow
def test_a_plain_fit_is_told_which_pose_bends_it() -> None:
    dataset = moved(measured_arm(3, 25), [6], 50.0)
    assert fit_without_outliers(calibrate(measured_arm(3, 25))) is None
    plain = calibrate(dataset)
    robust = fit_without_outliers(plain)
    assert robust is not None
    hint = outlier_hint(plain, robust)
    assert f"{dataset.poses.ids[6]} (50" in hint
    assert " 0.1" in hint
