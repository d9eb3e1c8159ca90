"""Check names what happened between training and test poses, and fails where far more than noise is left."""

from __future__ import annotations

import numpy as np
import pytest

from calib import calibrate, check
from calib.dataset.dataset import Dataset
from calib.frames import rotation_from_rotvec
from calib.present.over_time.checks import item_sentence
from calib.simulation.simulate import simulate_dataset
from calib.validation.acceptance import Check
from calib.validation.remounting import remounting
from tests.support.changed import with_xyz


def simulated(seed: int = 0, poses: int = 64) -> Dataset:
    return simulate_dataset("rb5", rng=seed, poses=poses).dataset


def with_points_mm(dataset: Dataset, xyz_mm: np.ndarray) -> Dataset:
    return with_xyz(dataset, xyz_mm)


def scanner_moved(dataset: Dataset) -> Dataset:
    """Test poses seen from a scanner that was knocked: 3 mm and 0.3 deg."""
    points = dataset.points
    centre = points.xyz_mm.mean(axis=0)
    turned = (points.xyz_mm - centre) @ rotation_from_rotvec(np.array([0.0, 0.005, 0.0])).T + centre
    is_test = dataset.poses.is_test[points.pose][:, None]
    return with_points_mm(dataset, np.where(is_test, turned + np.array([0.0, 3.0, 0.0]), points.xyz_mm))


def tool_moved(dataset: Dataset) -> Dataset:
    """Test poses with a tool that sits 2 mm further along the flange's x."""
    points = dataset.points
    fitted = calibrate(dataset)
    turn = fitted.model.state(fitted.fit.x, dataset.poses).attitude[points.pose]
    scanner_R_base = next(iter(fitted.after.scanner_T_base.values()))[:3, :3]
    shift = (scanner_R_base @ turn @ np.array([2.0, 0.0, 0.0])[:, None])[..., 0]
    is_test = dataset.poses.is_test[points.pose][:, None]
    return with_points_mm(dataset, points.xyz_mm + np.where(is_test, shift, 0.0))


def words_of(result: Check, name: str) -> str:
    return next(item_sentence(item) for item in result.items if item.name == name)


def test_points_that_are_off_all_alike_are_told_by_what_moved() -> None:
    dataset = simulated()
    assert remounting(calibrate(dataset)) is None
    knocked, other_tool = (remounting(calibrate(moved(dataset))) for moved in (scanner_moved, tool_moved))
    assert knocked.what == "scanner"
    assert knocked.shift_mm == pytest.approx(3.0, abs=0.5)
    assert np.degrees(knocked.turn_rad) == pytest.approx(0.286, abs=0.05)
    assert other_tool.what == "tool"
    assert other_tool.shift_mm == pytest.approx(2.0, abs=0.2)
    assert max(knocked.after_mm, other_tool.after_mm) < 0.25


@pytest.mark.thorough
@pytest.mark.parametrize("poses", [64, 130])
def test_check_fails_where_many_times_the_noise_is_left_however_many_poses(poses: int) -> None:
    dataset = simulated(1, poses)
    points = dataset.points
    rng = np.random.default_rng(0)
    spoilt = check(with_points_mm(dataset, points.xyz_mm + rng.normal(size=points.xyz_mm.shape)))
    assert not spoilt.passed
    assert "times the declared sigma: the arm is not calibrated" in words_of(spoilt, "noise")
    assert check(dataset).passed
