"""A cause as it is told: the joint that moves the tool the most, its size, and the pose where it shows."""

from __future__ import annotations

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.causes import cause_of, worst_pose
from calib.diagnosis.decision_rules import left_to_curves
from calib.diagnosis.result import Diagnosis
from calib.present.cause.verdict import cause
from calib.rendering.blocks import plain
from tests.support import ROOT


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(load_dataset(ROOT / "sample_data" / "hidden_effect_b"))


@pytest.mark.thorough
@pytest.mark.slow
def test_the_joints_the_size_and_the_pose_of_each_effect(found: Diagnosis) -> None:
    links, first, both = (step.calibration for step in found.steps)
    compliance = cause_of("joint_compliance", links, first)
    assert compliance.joints == (4,)
    assert "stiffness 12 kNm/rad" in plain(cause(compliance, first))
    backlash = cause_of("backlash", first, both)
    assert backlash.joints[0] == 1
    assert sorted(backlash.joints) == list(range(1, 7))  # that of joint 7 is not significant
    assert backlash.main is not None
    assert np.degrees(backlash.main.value) == pytest.approx(0.042, abs=5e-4)
    for one, before, after in ((compliance, links, first), (backlash, first, both)):
        assert one.largest is not None
        moved_mm = np.linalg.norm(after.after.error_mm - before.after.error_mm, axis=1)
        assert one.largest.size_mm == moved_mm.max()
        assert found.calibration.dataset.poses.ids[after.after.pose[np.argmax(moved_mm)]] == one.largest.pose
    assert cause_of("backlash", first, first).joints == ()


@pytest.mark.thorough
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


def the_lead_is_over_the_one_named(found: Diagnosis) -> None:
    """The evidence of the runner-up that is named and the lead over it add up to that of the effect, as ranked."""
    added = list(zip(found.steps, found.steps[1:], strict=False))
    assert added
    for before, after in added:
        if after.candidate is None:
            continue
        assert before.screening is not None
        evidence = {c.name: c.log_evidence for c in before.screening.candidates}
        assert after.log_bayes_factor is not None
        assert evidence[after.candidate.name] == pytest.approx(evidence[after.runner_up] + after.log_bayes_factor)


@pytest.mark.slow
def test_the_lead_is_over_the_effect_that_is_named(found: Diagnosis) -> None:
    the_lead_is_over_the_one_named(found)


@pytest.mark.thorough
def test_what_is_left_to_curves_is_no_runner_up() -> None:
    """A real arm, whose ranking begins with causes of one place that its curves explain clearly better."""
    found = diagnose(load_dataset(ROOT / "sample_data" / "ur10_ipa"))
    the_lead_is_over_the_one_named(found)
    before, after = found.steps[:2]
    assert before.screening is not None
    assert after.candidate is not None
    assert set(left_to_curves(before.screening, before.curves, after.candidate)) == {"joint_dent", "high_harmonic"}
    assert "joint_dent and high_harmonic rank above it, but curves" in found.summary()
