"""Repeats of one pose are no independent poses: inference from them equals inference from their mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, cross_validate, diagnose, screen
from calib.calibration.noise_level import check_sigma
from calib.dataset.dataset import Dataset, Points, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import effects_for
from calib.options import FitOptions
from calib.present.fit.calibration import calibration_warnings
from tests.support.arms import dataset_of, elementary_points, perturbed
from tests.support.changed import with_poses
from tests.support.repeated_points import repeated

SIGMA_MM = 0.05
REPEATS = 5


def unmodelled(seed: int, *, rough_rad: float, poses: int = 20, test: int = 6) -> Dataset:
    """Poses of an arm whose joint 3 is off by an amount of its own at every pose, which no effect follows; no noise."""
    rng = np.random.default_rng(seed)
    robot = builtin_robot("rb5")
    true = perturbed(robot, rng)
    dataset = dataset_of(robot, true, rng, poses=poses + test, test=test, sigma_mm=SIGMA_MM)
    off = np.zeros_like(dataset.poses.q)
    off[:, 2] = rough_rad * rng.normal(size=len(off))
    xyz = elementary_points(true, dataset.poses.q + off)
    return dataset.with_points(Points(np.arange(len(xyz)), xyz, np.full(len(xyz), "jig")))


def by_hand(dataset: Dataset) -> Dataset:
    """The dataset with the mean of each pose's repeats as one pose, its sigma divided by the root of their number."""
    poses = dataset.poses.select(np.arange(0, len(dataset.poses), REPEATS))
    xyz = dataset.points.xyz_mm.reshape(-1, REPEATS, 3).mean(axis=1)
    points = Points(np.arange(len(xyz)), xyz, np.full(len(xyz), "jig"))
    return replace(dataset, poses=poses, points=points, scanner=Scanner(SIGMA_MM / np.sqrt(REPEATS)))


@pytest.mark.parametrize(("seed", "rounds"), [(0, False), (1, True), (2, False)])
@pytest.mark.thorough
def test_evidence_is_that_of_the_means(seed: int, rounds: bool) -> None:
    repeats = repeated(
        unmodelled(seed, rough_rad=5e-4),
        REPEATS,
        np.random.default_rng(seed),
        noise_mm=SIGMA_MM,
        rounds=rounds,
    )
    if rounds:  # the same rows sorted, for the mean by hand
        order = np.argsort(np.tile(np.arange(26), REPEATS), kind="stable")
        points = replace(repeats.points, pose=np.arange(len(order)), xyz_mm=repeats.points.xyz_mm[order])
        means = by_hand(replace(repeats, poses=repeats.poses.select(order), points=points))
    else:
        means = by_hand(repeats)
    ours, theirs = calibrate(repeats), calibrate(means)
    np.testing.assert_allclose(ours.fit.x, theirs.fit.x, atol=1e-7)
    np.testing.assert_allclose(ours.fit.sigma, theirs.fit.sigma, rtol=1e-6)
    assert ours.sigma_mm == pytest.approx(theirs.sigma_mm)
    assert check_sigma(ours).verdict == "excess"
    found = {c.name: c for c in screen(ours, effects_for(ours.fitted_dataset)).candidates}
    expected = {c.name: c for c in screen(theirs, effects_for(means)).candidates}
    assert found.keys() == expected.keys()
    for name, candidate in found.items():
        assert candidate.p_value == pytest.approx(expected[name].p_value, rel=1e-4)
        assert candidate.log_evidence == pytest.approx(expected[name].log_evidence, abs=1e-4)
    one, other = diagnose(repeats), diagnose(means)
    assert one.missing == other.missing
    assert one.ambiguous_set == other.ambiguous_set


def test_rows_of_one_pose_count_once() -> None:
    repeats = repeated(unmodelled(3, rough_rad=5e-4), REPEATS, np.random.default_rng(3), noise_mm=SIGMA_MM)
    means = by_hand(repeats)
    assert repeats.points is not None
    rows = replace(
        means, points=replace(repeats.points, pose=np.repeat(np.arange(26), REPEATS)), scanner=repeats.scanner
    )
    ours, theirs = calibrate(rows), calibrate(means)
    np.testing.assert_allclose(ours.fit.sigma, theirs.fit.sigma, rtol=1e-6)
    assert ours.fit.rows == theirs.fit.rows == 60
    assert "130 points were measured in 26 repeat groups" in " ".join(calibration_warnings(ours))


@pytest.mark.slow
def test_repeats_taken_for_poses_would_name_what_is_not_there() -> None:
    """Without averaging, the evidence of an absent effect grows with the number of repeats."""

    def best(dataset: Dataset) -> float:
        return min(c.p_value for c in screen(calibrate(dataset), effects_for(dataset)).candidates)

    repeats = repeated(unmodelled(4, rough_rad=5e-4), REPEATS, np.random.default_rng(4), noise_mm=SIGMA_MM)
    jittered = repeats.poses.q + np.radians(1e-3) * np.random.default_rng(0).normal(size=repeats.poses.q.shape)
    assert best(with_poses(repeats, q=jittered)) < 1e-3 * best(repeats)


def found_in_clean_arm(seed: int, noise_mm: float = SIGMA_MM) -> Diagnosis:
    dataset = unmodelled(100 + seed, rough_rad=0.0)
    return diagnose(repeated(dataset, REPEATS, np.random.default_rng(seed), noise_mm=noise_mm))


@pytest.mark.slow
def test_noise_comes_from_the_repeats() -> None:
    found = found_in_clean_arm(0)
    assert found.residual_tests.noise_from == "repeats"
    assert found.residual_tests.noise_mm == pytest.approx(SIGMA_MM / np.sqrt(REPEATS), rel=0.1)
    rough = repeated(unmodelled(7, rough_rad=5e-4), REPEATS, np.random.default_rng(7), noise_mm=SIGMA_MM)
    lack = diagnose(rough).residual_tests.lack_of_fit_p
    assert lack < 1e-6


@pytest.mark.thorough
def test_a_clean_arm_gives_no_name() -> None:
    found = [found_in_clean_arm(seed) for seed in range(20)]
    assert sum(bool(one.missing) for one in found) <= 1  # 0.2 are to be expected at the level of 1 %
    assert sum(one.verdict == "adequate" for one in found) >= 18
    p_values = np.array([one.residual_tests.lack_of_fit_p for one in found])
    assert np.sum(p_values < 0.01) <= 1
    assert 0.3 < np.mean(p_values) < 0.7


@pytest.mark.slow
def test_held_out_poses_are_held_out_with_all_their_repeats() -> None:
    repeats = repeated(unmodelled(5, rough_rad=5e-4), REPEATS, np.random.default_rng(5), noise_mm=SIGMA_MM)
    ours, theirs = cross_validate(repeats), cross_validate(by_hand(repeats))
    assert ours.held_out.points == 100
    for one, other in zip(ours.folds, theirs.folds, strict=True):
        assert len(one.poses) == REPEATS * len(other.poses)
        assert {int(pose[1:]) // REPEATS for pose in one.poses} == {int(pose[1:]) // REPEATS for pose in other.poses}
    of_repeats = 3.0 * SIGMA_MM**2 * (1.0 - 1.0 / REPEATS)  # scatter about their means
    assert ours.held_out.rmse_mm**2 == pytest.approx(theirs.held_out.rmse_mm**2 + of_repeats, rel=0.05)
    assert "100 points were measured in 20 repeat groups" in " ".join(ours.notes)


@pytest.mark.parametrize("residual", ["distance", "pairs"])
def test_other_residuals(residual: str) -> None:
    repeats = repeated(unmodelled(6, rough_rad=5e-4, poses=40), REPEATS, np.random.default_rng(6), noise_mm=SIGMA_MM)
    options = FitOptions(residual=residual)
    ours, theirs = calibrate(repeats, options), calibrate(by_hand(repeats), options)
    np.testing.assert_allclose(ours.fit.sigma, theirs.fit.sigma, rtol=1e-5)


def test_too_few_stands_for_a_fit_stay_as_they_are() -> None:
    repeats = repeated(unmodelled(8, rough_rad=0.0, poses=4, test=0), 10, np.random.default_rng(8), noise_mm=SIGMA_MM)
    assert calibrate(repeats).averaged is None
