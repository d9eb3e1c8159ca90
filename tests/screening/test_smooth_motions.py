"""Dents and slips are named at their place, unknown motions of a joint told; none on noise or before a true effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.effects.catalogue import effects_for
from calib.effects.catalogue.joints import JointDent
from calib.effects.catalogue.order_steps import JointStep
from calib.effects.shaped import ShapedEffect
from calib.screening.candidates import Candidate
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import FAULT_EVIDENCE, run_residual_tests
from calib.screening.smooth_motions import smooth_motion
from calib.simulation.simulate import Simulation, simulate_dataset
from calib.simulation.truth.joint_effects import JointDent as TrueDent
from calib.simulation.truth.order_effects import JointStep as TrueStep
from tests.support.changed import with_xyz


def simulated(effects: tuple[str, ...] = (), *, seed: int = 0, sigmas: float = 2.0, robot: str = "rb5") -> Simulation:
    return simulate_dataset(
        robot,
        rng=np.random.default_rng([7, seed]),
        effects=effects,
        visible_sigmas=sigmas if effects else None,
        conditions=True,
        poses=80,
        noise_mm=0.05,
    )


def stated(candidate: Candidate) -> tuple[ShapedEffect, float]:
    """The only member of a candidate and its size."""
    (member,), (value,) = candidate.members, candidate.values
    assert isinstance(member, ShapedEffect)
    return member, value.value


@pytest.mark.parametrize(("robot", "seed"), [("rb5", 1), ("panda", 2), ("rb5", 3)])
@pytest.mark.thorough
def test_a_dent_is_named_at_its_joint_and_place_and_no_harmonic_in_its_stead(robot: str, seed: int) -> None:
    simulation = simulated(("joint_dent",), seed=seed, robot=robot)
    (true,) = simulation.truth.effects
    assert isinstance(true, TrueDent)
    (joint,) = np.flatnonzero(true.height_rad)
    result = diagnose(simulation.dataset)
    assert (result.verdict, result.missing) == ("named", ("joint_dent",)), result.summary()
    dent, size = stated(result.candidates[0])
    assert isinstance(dent, JointDent)
    assert dent.joint == joint
    off_rad = np.radians(dent.place_deg) - true.place_rad[joint]
    assert np.remainder(off_rad + np.pi, 2 * np.pi) - np.pi == pytest.approx(0, abs=0.2)
    assert size == pytest.approx(true.height_rad[joint], rel=0.35)
    assert f"joint {joint + 1} is off by" in result.summary()


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "seed"), [("rb5", 4), ("panda", 5)])
def test_a_slip_is_found_at_its_joint_and_pose(robot: str, seed: int) -> None:
    simulation = simulated(("joint_step",), seed=seed, robot=robot)
    (true,) = simulation.truth.effects
    assert isinstance(true, TrueStep)
    (joint,) = np.flatnonzero(true.offset_rad)
    dataset = simulation.dataset
    best = screen(calibrate(dataset), effects_for(dataset)).candidates[0]
    step, size = stated(best)
    assert isinstance(step, JointStep)
    assert step.joint == joint
    # Test poses, which no fit sees, may lie between the jump and the first pose that shows it.
    found = dataset.poses.index(step.start.pose)
    shown = np.flatnonzero(~dataset.poses.is_test)
    assert abs(int(np.searchsorted(shown, found)) - int(np.searchsorted(shown, true.first))) <= 2
    assert size == pytest.approx(true.offset_rad[joint], rel=0.2)


@pytest.mark.slow
def test_a_hose_that_pulls_is_an_unknown_motion() -> None:
    told = 0
    for seed in range(4):
        found = smooth_motion(project_residual(calibrate(simulated(("hose_pull",), seed=seed).dataset)))
        told += found is not None and found.log_evidence > FAULT_EVIDENCE
    assert told >= 3


@pytest.mark.slow
def test_noise_tells_no_story() -> None:
    for seed in range(12):
        left = project_residual(calibrate(simulated(seed=seed, robot=("rb5", "panda")[seed % 2]).dataset))
        found = smooth_motion(left)
        assert found.log_evidence < FAULT_EVIDENCE


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["transmission_error", "joint_scale", "backlash", "scanner_drift"])
def test_an_effect_that_is_spread_says_more_than_one_of_a_place_or_a_pose(effect: str) -> None:
    dataset = simulated((effect,), seed=11).dataset
    first, *others = screen(calibrate(dataset), effects_for(dataset)).candidates
    assert first.name == effect
    assert max(c.log_evidence for c in others if c.family.sparse) < first.log_evidence - 10.0


def test_one_wrong_pose_is_no_dent() -> None:
    dataset = simulated(seed=20).dataset
    xyz = dataset.points.xyz_mm.copy()
    wrong = int(np.flatnonzero(~dataset.poses.is_test)[17])
    xyz[wrong] += [1.0, -1.0, 0.8]
    spoilt = with_xyz(dataset, xyz)
    residual_tests = run_residual_tests(spoilt, project_residual(calibrate(spoilt)))
    assert residual_tests.outlier_poses == (dataset.poses.ids[wrong],)
    assert residual_tests.fault is None


def test_what_is_found_does_not_depend_on_the_noises_unit() -> None:
    left = project_residual(calibrate(simulated(("hose_pull",), seed=4).dataset))
    one, seven = smooth_motion(left), smooth_motion(replace(left, residual=7.0 * left.residual))
    assert seven.log_evidence == pytest.approx(one.log_evidence, abs=0.1)  # sizes come from a grid
    assert seven.size == pytest.approx(7.0 * one.size, rel=0.01)
