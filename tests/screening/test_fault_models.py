"""Dents, slips and unknown motions of one joint: told where they are, silent on noise, and behind a true effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.calibration.calibrate import calibrate
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.decision_rules import MIN_LEAD, leading_fault
from calib.diagnosis.diagnose import diagnose
from calib.effects.catalogue import effects_for
from calib.screening.candidates import screen
from calib.screening.fault_models import best_bump_or_jump, smooth_motion
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import FAULT_EVIDENCE, run_residual_tests
from calib.simulation.measured_dataset import Simulation
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.joint_effects import KinkedJoint, Slip


def simulated(
    effects: tuple[str, ...] = (), *, seed: int = 0, sigmas: float = 2.0, robot: str = "rb5"
) -> Simulation:
    return simulate_dataset(
        builtin_robot(robot),
        rng=np.random.default_rng([7, seed]),
        effects=effects,
        visible_sigmas=sigmas if effects else None,
        conditions=True,
        poses=80,
        noise_mm=0.05,
    )


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "seed"), [("rb5", 1), ("panda", 2), ("rb5", 3)])
def test_a_dent_is_found_at_its_joint_and_place_and_no_harmonic_is_named_in_its_stead(
    robot: str, seed: int
) -> None:
    simulation = simulated(("kinked_joint",), seed=seed, robot=robot)
    (true,) = simulation.truth.effects
    assert isinstance(true, KinkedJoint)
    (joint,) = np.flatnonzero(true.height_rad)
    result = diagnose(simulation.dataset)
    assert result.verdict == "unexplained"
    assert not result.missing
    fault = result.leading_fault
    assert fault is not None
    assert (fault.kind, fault.joint) == ("bump", joint)
    assert np.remainder(fault.place_rad - true.place_rad[joint] + np.pi, 2 * np.pi) - np.pi == pytest.approx(
        0, abs=0.2
    )
    assert fault.size == pytest.approx(true.height_rad[joint], rel=0.35)
    assert f"joint {joint + 1}" in result.summary()


@pytest.mark.parametrize(("robot", "seed"), [("rb5", 4), ("panda", 5)])
def test_a_slip_is_found_at_its_joint_and_pose(robot: str, seed: int) -> None:
    simulation = simulated(("slip",), seed=seed, robot=robot)
    (true,) = simulation.truth.effects
    assert isinstance(true, Slip)
    (joint,) = np.flatnonzero(true.offset_rad)
    fault = best_bump_or_jump(project_residual(calibrate(simulation.dataset)))
    assert fault is not None
    assert (fault.kind, fault.joint) == ("jump", joint)
    # Test poses, which no fit sees, may lie between the jump and the first pose that shows it.
    found = simulation.dataset.poses.index(fault.pose_id)
    shown = np.flatnonzero(~simulation.dataset.poses.is_test)
    assert abs(int(np.searchsorted(shown, found)) - int(np.searchsorted(shown, true.first))) <= 2
    assert fault.size == pytest.approx(true.offset_rad[joint], rel=0.2)


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
        for found in (best_bump_or_jump(left), smooth_motion(left)):
            assert found is not None
            assert found.log_evidence < FAULT_EVIDENCE


@pytest.mark.parametrize("effect", ["transmission_error", "joint_scale", "backlash", "scanner_drift"])
def test_an_effect_of_the_catalogue_says_more_than_a_dent_or_a_slip(effect: str) -> None:
    dataset = simulated((effect,), seed=11).dataset
    screening = screen(calibrate(dataset), effects_for(dataset))
    fault = best_bump_or_jump(screening.projected)
    assert screening.candidates[0].name == effect
    assert fault is not None
    assert fault.log_evidence < screening.candidates[0].log_evidence + MIN_LEAD
    assert leading_fault(screening) is None


def test_one_wrong_pose_is_no_dent() -> None:
    dataset = simulated(seed=20).dataset
    assert dataset.points is not None
    xyz = dataset.points.xyz_mm.copy()
    wrong = int(np.flatnonzero(~dataset.poses.is_test)[17])
    xyz[wrong] += [1.0, -1.0, 0.8]
    spoilt = dataset.with_points(replace(dataset.points, xyz_mm=xyz))
    residual_tests = run_residual_tests(spoilt, project_residual(calibrate(spoilt)))
    assert residual_tests.outlier_poses == (dataset.poses.ids[wrong],)
    assert residual_tests.fault is None


def test_the_story_does_not_depend_on_the_noises_unit() -> None:
    left = project_residual(calibrate(simulated(("slip",), seed=4).dataset))
    scaled = replace(left, residual=7.0 * left.residual)
    one, seven = best_bump_or_jump(left), best_bump_or_jump(scaled)
    assert one is not None
    assert seven is not None
    assert seven.log_evidence == pytest.approx(one.log_evidence)
    assert seven.size == pytest.approx(7.0 * one.size)
