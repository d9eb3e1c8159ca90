"""A cause as it is told: the joint that moves the tool the most, its size, and the pose where it shows."""

from __future__ import annotations

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.words.causes import cause_of, worst_pose
from tests.support import ROOT


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(load_dataset(ROOT / "sample_data" / "hidden_effect_b"))


@pytest.mark.slow
def test_the_joints_the_size_and_the_pose_of_each_effect(found: Diagnosis) -> None:
    links, first, both = (step.calibration for step in found.steps)
    compliance = cause_of("joint_compliance", links, first)
    assert compliance.joints == (4,)
    assert "stiffness 12 kNm/rad" in compliance.size
    backlash = cause_of("backlash", first, both)
    assert backlash.joints[0] == 1
    assert sorted(backlash.joints) == list(range(1, 8))
    assert backlash.size == "0.042\N{DEGREE SIGN}"
    for cause, before, after in ((compliance, links, first), (backlash, first, both)):
        assert cause.largest is not None
        moved_mm = np.linalg.norm(after.after.error_mm - before.after.error_mm, axis=1)
        assert cause.largest.size_mm == moved_mm.max()
        assert (
            found.calibration.dataset.poses.ids[after.after.pose[np.argmax(moved_mm)]] == cause.largest.pose
        )
    assert cause_of("backlash", first, first).joints == ()


@pytest.mark.slow
def test_the_pose_that_is_off_the_most(found: Diagnosis) -> None:
    fit = found.calibration
    errors_mm = np.linalg.norm(fit.after.error_mm, axis=1)
    worst = worst_pose(fit)
    assert worst is not None
    assert worst.size_mm == errors_mm.max()
    only = worst_pose(fit, ("p03",))
    assert only is not None
    assert only.pose == "p03"
    assert worst_pose(fit, ("nowhere",)) is None
