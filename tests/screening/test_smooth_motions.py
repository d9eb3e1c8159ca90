"""Dents and slips are named at their place, unknown motions of a joint told; none on noise or before a true effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, screen
from calib.effects.catalogue import effects_for
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import FAULT_EVIDENCE, run_residual_tests
from calib.screening.smooth_motions import smooth_motion
from calib.simulation.simulate import Simulation, simulate_dataset
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
