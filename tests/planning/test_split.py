"""Poses that settle an open set: what they promise, what a payload adds, and what no pose settles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.calibration.calibrate import calibrate
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.open_sets import Doubt
from calib.effects.catalogue import effects_for
from calib.errors import CalibError
from calib.planning.plan import plan_poses
from calib.planning.purposes.split import ForSplit, open_set_of
from calib.screening.candidates import screen
from calib.screening.rivals.predictions import Rival
from calib.simulation.simulate import simulate_dataset
from calib.workcell.measurable import measurable


@pytest.fixture(scope="module")
def doubt() -> Doubt:
    """Bending of links or compliance of joints: an arm without payload, one sigma of bending."""
    rng = np.random.default_rng(10)
    dataset = simulate_dataset(builtin_robot("rb5"), rng=rng, effects=[("link_bending", 1.0)], poses=40).dataset
    calibration = calibrate(dataset)
    families = [f for f in effects_for(dataset) if f.name in ("link_bending", "joint_compliance")]
    ranked = screen(calibration, families).candidates
    return Doubt(calibration, tuple(Rival.of(candidate) for candidate in ranked))


@pytest.mark.slow
def test_a_plan_that_settles_says_how_surely_and_can_be_measured(doubt: Doubt) -> None:
    purpose = ForSplit(doubt)
    plan = plan_poses(purpose.start, 5, purpose=purpose, candidates=150)
    assert plan.settles is not None
    assert 0.0 < plan.settles < 0.9
    assert len(plan.poses) == 5
    assert plan.shots == 1
    assert any("--payload-kg" in line for line in plan.told)
    assert all("the rivals differ by" in words for words in plan.why)
    assert measurable(purpose.start.cell, plan.poses.q).ok.all()
    assert plan.poses.payload_kg is None


@pytest.mark.slow
def test_a_payload_tells_more_and_is_mounted_once(doubt: Doubt) -> None:
    bare = plan_poses(ForSplit(doubt).start, 5, purpose=ForSplit(doubt), candidates=150)
    loaded = ForSplit(doubt, payload_kg=5.0)
    plan = plan_poses(loaded.start, 5, purpose=loaded, candidates=150)
    assert plan.settles is not None
    assert bare.settles is not None
    assert plan.settles > bare.settles + 0.1
    payload_kg = plan.poses.payload_kg
    assert payload_kg is not None
    assert np.all(np.diff(payload_kg) >= 0.0)
    assert not any("--payload-kg" in line for line in plan.told)


@pytest.mark.slow
def test_where_the_mean_of_several_measurements_counts_it_settles_more(doubt: Doubt) -> None:
    once, often = (
        plan_poses(purpose.start, 5, purpose=purpose, candidates=100)
        for purpose in (ForSplit(doubt), ForSplit(doubt, most_shots=4))
    )
    assert once.settles is not None
    assert often.settles is not None
    assert often.settles > once.settles
    assert often.shots == 4
    assert any("4 times" in line for line in often.told)


def test_exact_twins_are_said_to_be_told_apart_by_no_pose(doubt: Doubt) -> None:
    first, other = doubt.rivals
    twins = replace(doubt, rivals=(first, replace(first, name="its twin"), other))
    purpose = ForSplit(twins)
    plan = plan_poses(purpose.start, 3, purpose=purpose, candidates=100)
    assert plan.settles is not None
    assert plan.settles < 0.5
    assert f"{first.name} and its twin make the same of every pose of this kind: none tells them apart" in plan.told
    assert any(line.startswith(f"what shows {first.name} alone: ") for line in plan.told)


@pytest.mark.slow
def test_a_rival_in_the_model_is_taken_out_of_it(doubt: Doubt) -> None:
    """An effect that stands for an open set is in the fit; what would be measured is predicted as without it."""
    first = doubt.rivals[0]
    inside = calibrate(doubt.calibration.dataset, effects=first.members, prior_sigmas=first.prior_sigmas)
    outside, standing = (
        plan_poses(purpose.start, 3, purpose=purpose, candidates=100).settles
        for purpose in (ForSplit(doubt), ForSplit(replace(doubt, calibration=inside)))
    )
    assert outside is not None
    assert standing == pytest.approx(outside, abs=0.15)


@pytest.mark.slow
def test_where_nothing_is_open_there_is_nothing_to_settle() -> None:
    clean = simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(8), poses=30).dataset
    with pytest.raises(CalibError, match="set of causes"):
        open_set_of(diagnose(clean))
