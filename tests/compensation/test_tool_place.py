"""A place of the tool is reached by joints within their limits, or is said not to be."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, frames
from calib.calibration.result import Calibration
from calib.compensation.tool_place import tool_frame, tool_place
from calib.errors import FitError
from tests.support.arms import dataset_of, jang_arm, perturbed


@pytest.fixture(scope="module")
def fit() -> Calibration:
    rng = np.random.default_rng(2)
    robot = jang_arm()
    return calibrate(dataset_of(robot, perturbed(robot, rng), rng, poses=40, noise_mm=0.05, range_rad=1.0))


def shifted(base_T_tool: np.ndarray, by_mm: tuple[float, float, float]) -> np.ndarray:
    return frames.make_transform(base_T_tool[:3, :3], base_T_tool[:3, 3] + by_mm)


def test_at_the_tool_itself_the_joints_stay(fit: Calibration) -> None:
    goal = tool_frame(fit, fit.dataset.poses)[3]
    place = tool_place(fit, goal, 3)
    assert place.reached
    np.testing.assert_allclose(place.q, fit.dataset.poses.q[3], atol=1e-9)
    assert place.outside == ()
    assert place.error is not None
    assert place.error.length_mm[0] == pytest.approx(
        np.linalg.norm((fit.before.error_mm - fit.after.error_mm)[fit.after.pose == 3]), rel=1e-6
    )


def test_the_calibrated_arm_stands_where_it_was_brought(fit: Calibration) -> None:
    for pose in range(6):
        goal = shifted(tool_frame(fit, fit.dataset.poses)[pose], (15.0, -10.0, -20.0))
        place = tool_place(fit, goal, pose)
        if place.reached:
            np.testing.assert_allclose(fit.predict(place.poses.q)[0], goal[:3, 3], atol=1e-3)
            np.testing.assert_allclose(tool_frame(fit, place.poses)[0][:3, :3], goal[:3, :3], atol=1e-4)
    assert place.reached


def test_joints_that_leave_the_trained_ranges_are_named(fit: Calibration) -> None:
    q = fit.dataset.poses.q[[0]].copy()
    q[0, 5] += 2.5  # trained within 1 rad
    goal = tool_frame(fit, replace(fit.dataset.poses.select(np.array([0])), q=q))[0]
    place = tool_place(fit, goal, 0, q[0])
    assert place.reached
    assert place.outside == (5,)
    assert "joint 6" in place.summary()
    assert place.to_dict()["joints_outside"] == [6]


def test_what_is_out_of_reach_is_said(fit: Calibration) -> None:
    goal = shifted(tool_frame(fit, fit.dataset.poses)[0], (9000.0, 0.0, 0.0))
    place = tool_place(fit, goal, 0)
    assert not place.reached
    assert place.error is None
    assert place.missed_mm > 5000.0
    assert "cannot be reached" in place.headline
    json.dumps(place.to_dict(), allow_nan=False)
    with pytest.raises(FitError, match="finite"):
        tool_place(fit, np.full((4, 4), np.nan), 0)


def test_another_posture_is_found_unless_only_the_near_ones_count() -> None:
    fit = calibrate("sample_data/hidden_effect_a")
    goal = shifted(tool_frame(fit, fit.dataset.poses)[5], (30.0, -40.0, 50.0))
    assert not tool_place(fit, goal, 5, everywhere=False).reached
    assert tool_place(fit, goal, 5).reached
