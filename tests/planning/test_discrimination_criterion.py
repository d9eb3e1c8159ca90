"""Poses that tell confounded effects apart: with which power, what a payload adds, and what no pose discriminates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.effects.catalogue import effects_for
from calib.errors import CalibError
from calib.planning.criterion import DiscriminationOutcome, SeparationReason
from calib.planning.discrimination import ForDiscrimination, for_confounded
from calib.planning.effect_hypotheses import EffectHypothesis, HypothesisSet
from calib.planning.plan import Plan, plan_poses
from calib.simulation.simulate import simulate_dataset
from calib.workcell.measurable import measurable


@pytest.fixture(scope="module")
def confounded() -> HypothesisSet:
    """Bending of links or compliance of joints: an arm without payload, one sigma of bending."""
    rng = np.random.default_rng(10)
    dataset = simulate_dataset("rb5", rng=rng, effects=[("link_bending", 1.0)], poses=40).dataset
    calibration = calibrate(dataset)
    families = [f for f in effects_for(dataset) if f.name in ("link_bending", "joint_compliance")]
    ranked = screen(calibration, families).candidates
    return HypothesisSet(calibration, tuple(EffectHypothesis.of(candidate) for candidate in ranked))


def outcome_of(plan: Plan) -> DiscriminationOutcome:
    assert isinstance(plan.outcome, DiscriminationOutcome)
    return plan.outcome


def test_a_plan_has_its_power_and_can_be_measured(confounded: HypothesisSet) -> None:
    criterion = ForDiscrimination(confounded)
    plan = plan_poses(criterion.start, 5, criterion=criterion, candidates=150)
    assert 0.0 < plan.power < 0.9
    assert len(plan.poses) == 5
    assert outcome_of(plan).payload_kg is not None
    assert all(isinstance(reason, SeparationReason) for reason in plan.reasons)
    assert measurable(criterion.start.cell, plan.poses.q).ok.all()
    assert plan.poses.payload_kg is None


def test_a_payload_tells_more_and_is_mounted_once(confounded: HypothesisSet) -> None:
    bare = plan_poses(ForDiscrimination(confounded).start, 5, criterion=ForDiscrimination(confounded), candidates=150)
    loaded = ForDiscrimination(confounded, payload_kg=5.0)
    plan = plan_poses(loaded.start, 5, criterion=loaded, candidates=150)
    assert plan.power > bare.power + 0.1
    payload_kg = plan.poses.payload_kg
    assert payload_kg is not None
    assert np.all(np.diff(payload_kg) >= 0.0)
    assert outcome_of(plan).payload_kg is None


def test_equivalent_effects_are_said_to_be_told_apart_by_no_pose(confounded: HypothesisSet) -> None:
    first, other = confounded.hypotheses
    equivalent = replace(confounded, hypotheses=(first, replace(first, name="its twin"), other))
    criterion = ForDiscrimination(equivalent)
    plan = plan_poses(criterion.start, 3, criterion=criterion, candidates=100)
    assert plan.power < 0.5
    assert (first.name, "its twin") in outcome_of(plan).equivalent
    assert first.name in dict(outcome_of(plan).confirm)


def test_a_hypothesis_in_the_model_is_taken_out_of_it(confounded: HypothesisSet) -> None:
    """An effect that stands for an open set is in the fit; what would be measured is predicted as without it."""
    first = confounded.hypotheses[0]
    inside = calibrate(confounded.calibration.dataset, effects=first.members, prior_sigmas=first.prior_sigmas)
    outside, standing = (
        plan_poses(criterion.start, 3, criterion=criterion, candidates=100).power
        for criterion in (ForDiscrimination(confounded), ForDiscrimination(replace(confounded, calibration=inside)))
    )
    assert outside is not None
    assert standing == pytest.approx(outside, abs=0.15)


@pytest.mark.slow
def test_where_nothing_is_open_there_is_nothing_to_plan() -> None:
    clean = simulate_dataset("rb5", rng=8, poses=30).dataset
    with pytest.raises(CalibError, match="left no effects confounded"):
        for_confounded(diagnose(clean))
