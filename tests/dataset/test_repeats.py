"""Repeat groups: which measurements form one, and the mean of their repeats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import check
from calib.dataset.dataset import Dataset, Orientations, Points
from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset.repeats import (
    average_repeats,
    find_repeats,
    groups_by_condition,
    pooled_sigma_mm,
    repeat_groups,
    scatter_against_covariances,
    without_poses,
)
from calib.fitting.observations import Observations
from tests.support.arms import dataset_of
from tests.support.changed import with_poses, with_xyz
from tests.support.repeated_points import repeated


def plain(poses: int = 6, noise_mm: float = 0.0) -> Dataset:
    robot = builtin_robot("rb5")
    return dataset_of(robot, robot, np.random.default_rng(0), poses=poses, noise_mm=noise_mm)


def test_a_dataset_without_repeats_is_returned_itself() -> None:
    dataset = plain()
    assert average_repeats(dataset) is dataset
    two_targets = dataset.with_points(
        Points(
            np.repeat(np.arange(6), 2),
            np.repeat(dataset.points.xyz_mm, 2, axis=0),
            np.tile(["jig", "smr"], 6),
        )
    )  # type: ignore[union-attr]
    assert average_repeats(two_targets) is two_targets
    assert average_repeats(replace(dataset, points=None)).points is None


def test_mean_covariance_and_noise_of_repeats() -> None:
    dataset = repeated(plain(), 5, np.random.default_rng(1), noise_mm=0.05)
    found = average_repeats(dataset)
    assert len(found.points) == 6
    assert found.poses.ids == dataset.poses.ids
    np.testing.assert_array_equal(found.points.pose, np.arange(6) * 5)
    np.testing.assert_allclose(found.points.xyz_mm, dataset.points.xyz_mm.reshape(6, 5, 3).mean(axis=1), atol=1e-10)
    covariance = Observations.of(found).covariance_mm2
    np.testing.assert_allclose(covariance, np.broadcast_to(0.05**2 / 5 * np.eye(3), covariance.shape))
    assert len(find_repeats(dataset)) == 6
    assert pooled_sigma_mm(find_repeats(dataset)) == pytest.approx(0.05, rel=0.3)
    assert "30 points were measured in 6 repeat groups" in found.notes[-1]
    assert found.warnings == dataset.warnings


def test_repeats_are_tested_against_their_own_covariances() -> None:
    """Repeats that scatter by 0.05 mm, with covariances of that size, of a third of it, and without any."""
    dataset = repeated(plain(), 5, np.random.default_rng(1), noise_mm=0.05)
    assert scatter_against_covariances(dataset) is None
    for said_mm, ratio in ((0.05, 1.0), (0.05 / 3, 3.0)):
        covariance = np.broadcast_to(said_mm**2 * np.eye(3), (30, 3, 3))
        repeats = replace(dataset, points=replace(dataset.points, covariance_mm2=covariance))
        found = scatter_against_covariances(repeats)
        assert found.dof == 3 * 6 * 4
        assert found.ratio == pytest.approx(ratio, rel=0.3)
        assert (found.p_value < 1e-6) == (ratio > 1)
        told = next(item for item in check(repeats).items if item.name == "repeats")
        assert told.warning == (ratio > 1)


def test_one_stand_that_was_measured_often_counts_as_the_others() -> None:
    dataset = plain()
    often = dataset.points.select(np.array([0] * 30 + [1, 2, 3, 4, 5]))
    noise_mm = 0.05 * np.random.default_rng(0).normal(size=often.xyz_mm.shape)
    found = average_repeats(dataset.with_points(replace(often, xyz_mm=often.xyz_mm + noise_mm)))
    covariance = Observations.of(found).covariance_mm2
    np.testing.assert_allclose(covariance, np.broadcast_to(0.05**2 * np.eye(3), covariance.shape))


@pytest.mark.parametrize(
    ("column", "values", "same"),
    [
        ("payload_kg", [0.0, 2.0], False),
        ("payload_kg", [2.0, 2.0], True),
        ("temperature_c", [20.0, 20.1], True),
        ("temperature_c", [20.0, 24.0], False),
        ("setup", ["a", "b"], False),
    ],
)
def test_conditions_divide_repeat_groups(column: str, values: list[object], same: bool) -> None:
    dataset = plain(1)
    poses = dataset.poses.select(np.array([0, 0]))
    group = groups_by_condition(replace(poses, **{column: np.array(values)}))  # type: ignore[arg-type]
    assert (group[0] == group[1]) == same


def test_approach_and_joints_divide_repeat_groups() -> None:
    poses = plain(1).poses.select(np.array([0, 0]))
    approach = np.ones((2, 6))
    approach[1, 3] = -1.0
    assert len(set(groups_by_condition(replace(poses, approach=approach)).tolist())) == 2
    q = poses.q.copy()
    q[1, 2] += np.radians(5e-7)
    assert len(set(groups_by_condition(replace(poses, q=q)).tolist())) == 1
    q[1, 2] += np.radians(5e-6)
    assert len(set(groups_by_condition(replace(poses, q=q)).tolist())) == 2


def test_a_slow_warming_at_one_place_is_several_repeat_groups() -> None:
    poses = plain(1).poses.select(np.zeros(101, dtype=int))
    group = groups_by_condition(replace(poses, temperature_c=np.linspace(20.0, 30.0, 101)))
    assert 30 < len(set(group.tolist())) <= 51


def in_rounds(drift_mm: float) -> Dataset:
    """Dataset of eight places visited in five rounds, all points shifted by `drift_mm` along x from round to round."""
    dataset = repeated(plain(8), 5, np.random.default_rng(2), noise_mm=0.05, rounds=True)
    points = dataset.points.xyz_mm + drift_mm * np.repeat(np.arange(5), 8)[:, None] * np.array([1.0, 0.0, 0.0])
    timed = replace(dataset.poses, time_s=np.arange(40) * 30.0)
    return replace(with_xyz(dataset, points), poses=timed)


def test_visits_are_apart_where_time_shows() -> None:
    steady, drifting = in_rounds(0.0), in_rounds(0.1)
    assert len(np.unique(repeat_groups(steady))) == 8
    assert len(average_repeats(steady).points) == 8  # type: ignore[arg-type]
    assert len(np.unique(repeat_groups(drifting))) == 40
    assert average_repeats(drifting) is drifting


def test_the_mean_of_time_and_temperature() -> None:
    dataset = repeated(plain(), 4, np.random.default_rng(3))
    timed = replace(
        dataset.poses,
        time_s=np.arange(24.0),
        temperature_c=np.repeat(np.arange(6.0), 4) + np.tile([0.0, 0.1, 0.0, 0.1], 6),
    )
    found = average_repeats(replace(dataset, poses=timed)).poses
    np.testing.assert_allclose(found.time_s[::4], np.arange(6) * 4 + 1.5)
    np.testing.assert_allclose(found.temperature_c[::4], np.arange(6) + 0.05)


def test_repeats_of_both_roles_give_a_warning() -> None:
    dataset = repeated(plain(), 4, np.random.default_rng(4))
    role = dataset.poses.role.copy()
    role[6:8] = "test"  # two of the four repeats of the second place
    found = average_repeats(with_poses(dataset, role=role))
    assert found.points is not None
    assert len(found.points) == 7
    assert "both training and test poses: 1, " in found.warnings[-1]
    assert dataset.poses.ids[4] in found.warnings[-1]


def test_the_reference_pose_keeps_the_mean_of_its_group() -> None:
    dataset = repeated(plain(), 3, np.random.default_rng(5))
    role = dataset.poses.role.copy()
    role[0], role[5] = "train", "reference"
    found = average_repeats(with_poses(dataset, role=role))
    np.testing.assert_array_equal(found.points.pose, [0, 5, 6, 9, 12, 15])


def test_orientations_are_averaged() -> None:
    dataset = repeated(plain(), 3, np.random.default_rng(6), noise_mm=0.05)
    rng = np.random.default_rng(7)
    true = Rotation.random(6, rng=rng)
    turns = Rotation.from_rotvec(0.01 * rng.normal(size=(18, 3)))
    repeats = (turns * Rotation.concatenate([true[i // 3] for i in range(18)])).as_matrix()
    repeats[0] = np.nan
    repeats[3:6] = np.nan
    covariance = np.broadcast_to(1e-4 * np.eye(3), (18, 3, 3))
    points = replace(dataset.points, orientations=Orientations(repeats, covariance))
    found = average_repeats(dataset.with_points(points))
    got = found.points.orientations.scanner_R_jig
    np.testing.assert_array_equal(found.points.orientations.known, [True, False, True, True, True, True])
    for k in (0, 2, 3, 4, 5):
        rows = [i for i in range(3 * k, 3 * k + 3) if np.isfinite(repeats[i]).all()]
        np.testing.assert_allclose(got[k], Rotation.from_matrix(repeats[rows]).mean().as_matrix(), atol=1e-9)
    turn = Observations.of(found).turn_covariance_rad2
    np.testing.assert_allclose(turn[0], 1e-4 / 2.0 * np.eye(3))
    np.testing.assert_allclose(turn[2], 1e-4 / 3.0 * np.eye(3))


def test_a_pose_is_left_out_with_its_repeats() -> None:
    dataset = repeated(plain(), 3, np.random.default_rng(8), noise_mm=0.05)
    left = without_poses(dataset, [dataset.poses.ids[3]])
    assert not np.any(np.isin(left.points.pose, [3, 4, 5]))
    assert len(find_repeats(left)) == 5


def test_a_row_written_twice_counts_once() -> None:
    dataset = plain()
    found = average_repeats(dataset.with_points(dataset.points.select(np.tile(np.arange(6), 2))))
    assert found.points.counts_as is not None
    np.testing.assert_array_equal(found.points.counts_as, np.ones(6))


def test_targets_measured_one_after_the_other_are_of_one_repeat_group() -> None:
    dataset = repeated(plain(), 3, np.random.default_rng(9))
    names = np.tile(["smr1", "smr2", "smr3"], 6)
    found = average_repeats(dataset.with_points(replace(dataset.points, target=names)))
    np.testing.assert_array_equal(found.points.pose, np.repeat(np.arange(6) * 3, 3))
    np.testing.assert_array_equal(found.points.target, names)
    np.testing.assert_array_equal(found.points.counts_as, np.ones(18))
