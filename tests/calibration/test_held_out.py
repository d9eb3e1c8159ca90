"""Test of the test poses' errors: passed by complete models, failed where test poses are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate
from calib.calibration.held_out import HeldOutTest, held_out_test
from calib.calibration.promise import learned_discrepancy
from calib.dataset.dataset import Dataset, Scanner
from calib.screening.left_out import far_test_poses, left_out_gain
from tests.support.arms import dataset_of, jang_arm, perturbed, random_transform
from tests.support.changed import with_poses

NOISE_MM = 0.05


def arm(seed: int, *, poses: int = 90, test: int = 60) -> Dataset:
    """Dataset of an arm with errors drawn from the prior and few training poses, so that parameters stay uncertain."""
    rng = np.random.default_rng(seed)
    robot = jang_arm()
    true = perturbed(robot, rng, mm=1.0, rad=np.radians(0.5))
    dataset = dataset_of(
        robot, true, rng, poses=poses, test=test, noise_mm=NOISE_MM, base_T_scanner=random_transform(rng)
    )
    return replace(dataset, scanner=Scanner(NOISE_MM))


def judged(dataset: Dataset, noise_from: str = "dataset") -> HeldOutTest:
    test = held_out_test(calibrate(dataset), NOISE_MM, noise_from)
    assert test is not None
    return test


@pytest.mark.slow
def test_poses_far_off_are_found_without_any_promise_and_others_are_not() -> None:
    found = [far_test_poses(calibrate(arm(seed))) for seed in range(20)]
    assert not any(found)
    dataset = arm(3)
    points = dataset.points
    off = np.flatnonzero(dataset.poses.is_test)[::4]  # a quarter of them measured after a knock
    xyz_mm = points.xyz_mm + np.where(np.isin(points.pose, off), 1.5, 0.0)[:, None]
    far = far_test_poses(calibrate(dataset.with_points(replace(points, xyz_mm=xyz_mm))))
    assert set(far) <= {dataset.poses.ids[k] for k in off}
    assert len(far) > 0.8 * len(off)
    two = np.isin(points.pose, off[:2])
    few = points.xyz_mm + np.where(two, 1.5, 0.0)[:, None]
    assert far_test_poses(calibrate(dataset.with_points(replace(points, xyz_mm=few)))) == ()


def test_readings_of_a_test_pose_are_averaged_as_those_of_training_poses_are() -> None:
    """Single readings scatter twice as far as the means of four that the fit took."""
    dataset = arm(3)
    points, rng = dataset.points, np.random.default_rng(1)
    again = np.repeat(np.arange(len(points)), 4)
    xyz_mm = points.xyz_mm[again] + rng.normal(scale=0.5, size=(len(again), 3))
    calibration = calibrate(dataset.with_points(replace(points.select(again), xyz_mm=xyz_mm)))
    assert calibration.averaged is not None
    assert far_test_poses(calibration) == ()


@pytest.mark.slow
def test_the_promise_is_kept_where_nothing_is_missing_although_little_is_known() -> None:
    tests = [judged(arm(seed)) for seed in range(40)]
    assert not any(test.is_broken for test in tests)
    ratios = np.array([test.ratio for test in tests])
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.04)
    assert np.std(ratios) < 0.12
    promised = np.array([test.promised_mm for test in tests])
    found = np.array([test.rmse_mm for test in tests])
    assert np.median(promised) > 1.1 * np.sqrt(3.0) * NOISE_MM  # the parameters' part is no small one here
    assert np.sqrt(np.mean(found**2) / np.mean(promised**2)) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("noise_from", ["dataset", "fit"])
def test_test_poses_that_are_off_break_it_one_alone_does_not(noise_from: str) -> None:
    dataset = arm(3, test=30)
    points = dataset.points
    rng = np.random.default_rng(0)
    is_test = dataset.poses.is_test[points.pose]
    further = points.xyz_mm + 0.1 * is_test[:, None] * rng.normal(size=points.xyz_mm.shape)
    assert judged(dataset.with_points(replace(points, xyz_mm=further)), noise_from).is_broken
    one = points.xyz_mm.copy()
    one[np.flatnonzero(is_test)[0]] += 2.0
    alone = judged(dataset.with_points(replace(points, xyz_mm=one)), noise_from)
    assert alone.ratio > 1.5
    assert not alone.is_broken


def test_a_few_test_poses_grossly_off_are_named_and_do_not_show_the_model_wrong() -> None:
    dataset = arm(3, test=30)
    points = dataset.points
    of_test = np.flatnonzero(dataset.poses.is_test[points.pose])
    names = [dataset.poses.ids[points.pose[row]] for row in of_test]
    few, many = points.xyz_mm.copy(), points.xyz_mm.copy()
    few[of_test[[4, 9]]] += 3.0
    many[of_test[:12]] += 3.0
    by_few = judged(dataset.with_points(replace(points, xyz_mm=few)), "dataset")
    assert by_few.alone == (names[4], names[9])
    assert by_few.is_broken
    assert not by_few.shows_the_model_wrong
    by_many = judged(dataset.with_points(replace(points, xyz_mm=many)), "dataset")
    assert by_many.alone == ()
    assert by_many.shows_the_model_wrong


def test_test_poses_of_a_place_without_training_poses_are_held_against_their_own_frame() -> None:
    dataset = arm(5, test=30)
    setup = np.where(dataset.poses.is_test, "elsewhere", "here")
    apart = with_poses(dataset, setup=setup)
    test = judged(apart)
    assert not test.is_broken
    assert test.ratio == pytest.approx(1.0, abs=0.25)


def test_too_few_test_poses_and_no_noise_promise_nothing() -> None:
    assert held_out_test(calibrate(arm(1, poses=43, test=3)), NOISE_MM, "dataset") is None
    assert held_out_test(calibrate(arm(1)), 0.0, "dataset") is None


def test_a_fit_gains_nothing_over_itself_and_much_over_the_nominal_arm() -> None:
    dataset = arm(2)
    fitted = calibrate(dataset)
    still = left_out_gain(fitted, fitted)
    assert (still.share, still.standard_errors) == (0.0, 0.0)
    held = calibrate(dataset, replace(fitted.options, fixed=("d1", "a2", "a3", "theta2", "theta3", "alpha4")))
    gain = left_out_gain(held, fitted)
    assert gain.share > 0.3
    assert gain.standard_errors > 3.0
    back = left_out_gain(fitted, held)
    assert back.standard_errors == pytest.approx(-gain.standard_errors)


def test_what_the_model_is_known_to_miss_counts_as_promised() -> None:
    calibration = calibrate(arm(2))
    plain = held_out_test(calibration, NOISE_MM, "dataset")
    missed = replace(learned_discrepancy(calibration), constant_mm2=3.0 * NOISE_MM**2, growth_mm2=0.0)
    wider = held_out_test(calibration, NOISE_MM, "dataset", missed)
    assert wider.rmse_mm == pytest.approx(plain.rmse_mm)
    assert wider.promised_mm**2 == pytest.approx(plain.promised_mm**2 + 9.0 * NOISE_MM**2, rel=0.1)
    assert 0.4 * plain.ratio < wider.ratio < 0.75 * plain.ratio
