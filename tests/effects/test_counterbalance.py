"""The spring that balances joint 2, and the waves of the joint that do nearly the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.effect_selection import recalled
from calib.effects.catalogue import family_of
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.joint_effects import TransmissionError
from tests.support.fit_cases import rich_dataset


@pytest.mark.thorough
def test_a_spring_is_never_called_a_gear_alone_and_a_wave_is_left_open() -> None:
    """Seeds at which the torque is so near a wave that nothing decides."""
    spring = simulate_dataset(
        "panda",
        rng=np.random.default_rng([77, 1]),
        effects=(("counterbalance", 1.5),),
        poses=80,
        conditions=True,
        noise_mm=0.05,
    )
    assert set(diagnose(spring.dataset).ambiguous_set) == {"counterbalance", "transmission_error"}
    robot = builtin_robot("rb5")
    first = np.zeros((6, 3))
    first[1, 0] = 5e-4
    wave = simulate_dataset(
        robot,
        rng=np.random.default_rng([78, 0]),
        effects=(TransmissionError(first, 0.0 * first),),
        poses=80,
        conditions=True,
        noise_mm=0.05,
    )
    found = diagnose(wave.dataset)
    assert "transmission_error" in (*found.missing, *found.ambiguous_set)
    assert "counterbalance" not in found.missing


def test_a_spring_between_those_of_the_grid_is_found_on_a_finer_one() -> None:
    dataset = simulate_dataset(
        "panda",
        rng=np.random.default_rng([77, 1]),
        effects=(("counterbalance", 6.0),),
        poses=80,
        noise_mm=0.02,
    ).dataset
    family = family_of(dataset, "counterbalance")
    fitted = calibrate(dataset)
    (coarse,) = screen(fitted, [replace(family, finer=None)]).candidates
    (fine,) = screen(fitted, [family]).candidates
    (spring,) = fine.members
    assert fine.log_evidence > coarse.log_evidence + 2.0
    assert spring not in family.members
    kept = recalled(dataset, family.name, fine.prior_sigmas)  # as a session that was saved
    assert kept.members == fine.members


def test_an_arm_whose_second_joint_carries_no_weight_has_no_such_spring() -> None:
    dataset = rich_dataset()
    joints = dataset.robot.joints
    scara = replace(dataset.robot, joints=(replace(joints[0], alpha_rad=0.0), *joints[1:]))
    family = family_of(replace(dataset, robot=scara), "counterbalance")
    assert family.why_not == "joint 2 does not turn across joint 1"
