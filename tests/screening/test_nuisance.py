"""Masses that differ from robot.toml: nuisance of the effects of load in a model, never a cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.dataset.dataset import Dataset
from calib.diagnosis.effect_selection import SelectedEffect, calibrate_with
from calib.effects.catalogue import effects_for
from calib.screening.nuisance import REPORTED_EVIDENCE, Nuisance
from calib.screening.projected_residual import ProjectedResidual, project_residual
from calib.simulation.simulate import simulate_dataset
from tests.support.sweeps import sweep


def simulated(effects: Sequence[tuple[str, float]], *, robot: str = "rb5", seed: int = 2, off: bool = True) -> Dataset:
    """An arm whose masses robot.toml has 30 % off, each link's up or down."""
    rng = np.random.default_rng([7, seed])
    dataset = simulate_dataset(robot, rng=rng, effects=effects, conditions=True, poses=80, noise_mm=0.05).dataset
    if not off:
        return dataset
    joints = tuple(
        replace(joint, mass_kg=(joint.mass_kg or 0.0) * (1.0 + 0.3 * float(rng.choice([-1.0, 1.0]))))
        for joint in dataset.robot.joints
    )
    return replace(dataset, robot=replace(dataset.robot, joints=joints))


def left_with(dataset: Dataset, effect: str) -> ProjectedResidual:
    alone = calibrate(dataset)
    (family,) = (family for family in effects_for(dataset) if family.name == effect)
    (candidate,) = screen(alone, [family]).candidates
    return project_residual(calibrate_with(dataset, (SelectedEffect.of(candidate),), start=alone))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "robot", "seed"),
    sweep(
        [("joint_compliance", "rb5", 2), ("base_compliance", "rb5", 0), ("link_bending", "panda", 2)],
        every_run=[("joint_compliance", "rb5", 2)],
    ),
)
def test_the_errors_of_a_strong_first_effect_are_given_no_second_name(effect: str, robot: str, seed: int) -> None:
    found = diagnose(simulated([(effect, 20.0)], robot=robot, seed=seed))
    assert found.named == (effect,), found.summary()
    assert found.verdict == "named"
    assert "masses or centres of mass that differ from robot.toml" in found.summary()


@pytest.mark.slow
def test_only_an_effect_of_load_brings_masses_into_question() -> None:
    dataset = simulated([("transmission_error", 4.0)], off=False)
    assert project_residual(calibrate(dataset)).nuisance is None
    assert left_with(dataset, "transmission_error").nuisance is None
    bare = tuple(replace(joint, mass_kg=None, com_mm=None) for joint in dataset.robot.joints)
    assert left_with(replace(dataset, robot=replace(dataset.robot, joints=bare)), "joint_compliance").nuisance is None


@pytest.mark.slow
def test_wrong_masses_show_and_right_ones_do_not() -> None:
    wrong, right = (
        left_with(simulated([("joint_compliance", 20.0)], off=off), "joint_compliance") for off in (True, False)
    )
    assert wrong.nuisance.log_evidence > 10.0
    assert right.nuisance.log_evidence < REPORTED_EVIDENCE
    assert wrong.sigma == pytest.approx(1.0, rel=0.15)
    coloured = wrong.nuisance.coloured(wrong.residual)
    assert np.linalg.norm(coloured) > 1.1 * np.linalg.norm(wrong.residual)  # what masses took away


def test_a_residual_with_uncertain_directions_is_white_in_its_units() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((90, 3)) * [5.0, 1.0, 0.1]
    draws = rng.standard_normal((90, 20_000)) + columns @ rng.standard_normal((3, 20_000))
    nuisance = Nuisance.of(columns, rng.standard_normal(90), 90)
    nuisance = replace(nuisance, sizes=np.linalg.svd(columns, compute_uv=False))
    white = nuisance.whitened(draws)
    along = nuisance.directions.T @ white
    np.testing.assert_allclose(along @ along.T / draws.shape[1], np.eye(3), atol=0.05)
    np.testing.assert_allclose(nuisance.coloured(white), draws, atol=1e-9)
    assert Nuisance.of(np.zeros((90, 3)), rng.standard_normal(90), 90) is None
