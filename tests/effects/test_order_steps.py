"""Changes at one pose: what they displace, and what a diagnosis says of them beside other causes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import family_of
from calib.effects.catalogue.order_steps import LinkStep, PayloadStep
from calib.effects.effect import apply_values
from calib.effects.state import RobotState
from calib.simulation.simulate import Simulation, simulate_dataset
from calib.simulation.truth import order_effects as laws
from tests.support.fit_cases import rich_dataset

DATASET = rich_dataset()


def simulated(seed: int, *effects: tuple[str, float]) -> Simulation:
    arm = builtin_robot(("rb5", "panda")[seed % 2])
    rng = np.random.default_rng([77, seed])
    return simulate_dataset(arm, rng=rng, effects=effects, conditions=True, poses=64, noise_mm=0.05)


def test_a_changed_payload_turns_each_joint_by_its_own_torque() -> None:
    """As much as the gravity torques change where the same mass is in payload_kg."""
    member = family_of(DATASET, "payload_step").members[0]
    assert isinstance(member, PayloadStep)
    assert 0 not in member.joints  # whose axis is along gravity
    state = RobotState.nominal(DATASET.robot, DATASET.poses)
    after = apply_values(member, state, np.full(len(member.joints), 1e-4))
    turned = after.table[:, :-1, 3] - state.table[:, :-1, 3]
    torques = [
        RobotState.nominal(DATASET.robot, replace(DATASET.poses, payload_kg=np.full(40, kg))).gravity_torques_nm
        for kg in (2.0, 3.0)
    ]
    expected = 1e-4 * (torques[1] - torques[0]) * (DATASET.poses.order >= member.start.first)[:, None]
    joints = list(member.joints)
    np.testing.assert_allclose(turned[:, joints], expected[:, joints], atol=1e-12)
    np.testing.assert_allclose(np.delete(turned, joints, axis=1), 0.0)


@pytest.mark.thorough
def test_a_payload_that_changed_unsaid_is_found_beside_compliance() -> None:
    found = diagnose(simulated(3, ("payload_step", 4.0), ("joint_compliance", 4.0)).dataset)
    assert (found.verdict, found.missing) == ("named", ("payload_step", "joint_compliance"))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 1, 4])
def test_a_bent_link_is_told_as_none_of_the_steps_that_are_parts_of_it(seed: int) -> None:
    """With the size that it has: the frame at the link's end, as the exact law turns and shifts it."""
    simulation = simulated(seed, ("link_step", 4.0))
    (true,) = simulation.truth.effects
    assert isinstance(true, laws.LinkStep)
    found = diagnose(simulation.dataset)
    assert found.missing == ("link_step",)
    (member,) = found.calibration.model.added_effects
    assert isinstance(member, LinkStep)
    assert np.any(true.turn_rad[member.joint])


def test_links_that_are_short_or_near_the_target_are_not_asked_about() -> None:
    members = family_of(DATASET, "link_step").members
    assert {m.joint for m in members if isinstance(m, LinkStep)} == {0, 1, 2, 3}
    first, *others = DATASET.robot.joints
    gantry = replace(DATASET.robot, joints=(replace(first, type="prismatic"), *others))
    assert len(family_of(replace(DATASET, robot=gantry), "link_step").members) == len(members)
    short = replace(DATASET.robot, joints=tuple(replace(j, a_mm=0.0, d_mm=50.0) for j in DATASET.robot.joints))
    family = family_of(replace(DATASET, robot=short), "link_step")
    assert family.why_not == "no link with two joints beyond it is 100 mm long"
