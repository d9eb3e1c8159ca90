"""A cause as it is told: the joint that moves the tool the most, its size, and the pose where it shows."""

from __future__ import annotations

import numpy as np
import pytest

from calib.diagnosis.causes import cause_of
from calib.diagnosis.result import Diagnosis
from calib.present.diagnosis.verdict import cause
from calib.rendering.blocks import plain


@pytest.mark.thorough
def test_the_joints_the_size_and_the_pose_of_each_effect(found: Diagnosis) -> None:
    links, first, both = (step.calibration for step in found.steps)
    compliance = cause_of("joint_compliance", links, first)
    assert compliance.joints == (4,)
    assert "stiffness 12 kNm/rad" in plain(cause(compliance, first))
    backlash = cause_of("backlash", first, both)
    assert backlash.joints[0] == 1
    assert sorted(backlash.joints) == list(range(1, 7))  # that of joint 7 is not significant
    assert np.degrees(backlash.main.value) == pytest.approx(0.042, abs=5e-4)
    for one, before, after in ((compliance, links, first), (backlash, first, both)):
        moved_mm = np.linalg.norm(after.after.error_mm - before.after.error_mm, axis=1)
        assert one.largest.size_mm == moved_mm.max()
        assert found.calibration.dataset.poses.ids[after.after.pose[np.argmax(moved_mm)]] == one.largest.pose
    assert cause_of("backlash", first, first).joints == ()


@pytest.mark.slow
def test_the_lead_is_over_the_effect_that_is_named(found: Diagnosis) -> None:
    """The evidence of the runner-up that is named and the lead over it add up to that of the effect, as ranked."""
    added = list(zip(found.steps, found.steps[1:], strict=False))
    assert added
    for before, after in added:
        if after.candidate is None:
            continue
        evidence = {c.name: c.log_evidence for c in before.screening.candidates}
        assert evidence[after.candidate.name] == pytest.approx(evidence[after.runner_up] + after.log_bayes_factor)
