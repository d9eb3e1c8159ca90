"""Effects that stay an open set although one of them is in the model: exact twins, and rivals that need masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.decision_rules import are_equivalent, can_stand_for, rank_candidates
from calib.diagnosis.verdict import ConfoundedSet
from calib.effects.catalogue import effects_for
from calib.screening.residual_tests import ResidualTests
from calib.simulation.simulate import simulate_dataset
from tests.support.findings import concluded
from tests.support.sweeps import sweep

LOAD = {"joint_compliance", "link_bending", "base_compliance", "gravity_backlash"}


def simulated(
    *effects: tuple[str, float],
    robot: str = "rb5",
    seed: int = 1,
    masses: bool = False,
    tool_mm: float | None = None,
) -> Dataset:
    """tool_mm: of the tool point from the last axis, where it is another than the robot's."""
    arm = builtin_robot(robot)
    if tool_mm is not None:
        arm = replace(arm, tool=replace(arm.tool, a_mm=tool_mm))
    dataset = simulate_dataset(arm, rng=seed, effects=effects, conditions=True, poses=80, noise_mm=0.05).dataset
    if masses:
        return dataset
    joints = tuple(replace(joint, mass_kg=None, com_mm=None) for joint in dataset.robot.joints)
    return replace(dataset, robot=replace(dataset.robot, joints=joints))


def with_turning_error(dataset: Dataset, amplitude_rad: float) -> Dataset:
    """The last joint off once a turn, by the chain rule of one rotation: no code of the effects."""
    points = dataset.points
    frame = calibrate(dataset).before.scanner_T_base[""]
    poses = dataset.poses.q[points.pose]
    from calib.kinematics.chain import forward

    chain = forward(dataset.robot.table[None], poses, dataset.robot.is_revolute)
    last = dataset.robot.n_joints - 1
    axis, origin_mm = chain.base_T_frame[:, last, :3, 2], chain.base_T_frame[:, last, :3, 3]
    turn = amplitude_rad * np.sin(poses[:, last] - 0.4)
    moved = turn[:, None] * np.cross(axis, chain.target_mm - origin_mm)
    return dataset.with_points(replace(points, xyz_mm=points.xyz_mm + moved @ frame[:3, :3].T))


@pytest.fixture(scope="module")
def twins() -> Dataset:
    return with_turning_error(simulated(masses=True, seed=4, tool_mm=150.0), 1.5e-3)


@pytest.mark.thorough
def test_an_exact_twin_stays_in_the_set_whatever_its_prior(twins: Dataset) -> None:
    """Once a turn of the last joint's angle is twice a turn of its axis."""
    found = diagnose(twins)
    assert found.verdict == "ambiguous"
    assert found.missing == found.suspected == ()
    assert set(found.ambiguous_set) == {"transmission_error", "axis_wobble"}
    assert found.undecided is None
    (confounded,) = found.confounded_sets
    assert confounded.effect == found.steps[1].effect == found.ambiguous_set[0]
    assert found.calibration.sigma_mm < 0.06  # it stands in the model
    said = found.summary()
    assert "indistinguishable" in said
    assert "measure" in said
    document = found.to_dict()
    assert document["open_sets"][0]["effect"] == confounded.effect


def test_who_is_a_twin(twins: Dataset) -> None:
    screening = screen(calibrate(twins), effects_for(twins))
    ranked = {candidate.name: candidate for candidate in screening.candidates}
    one, other = ranked["transmission_error"], ranked["axis_wobble"]
    dof = screening.projected.dof
    assert are_equivalent(one, other, dof)
    assert are_equivalent(other, one, dof)
    assert can_stand_for(one, [other], dof)

    def twins_if(**changes: object) -> bool:
        return are_equivalent(one, replace(other, **changes), dof)  # type: ignore[arg-type]

    left = 1.0 - one.explained_share
    assert twins_if(explained_share=1.0 - 1.02 * left)
    assert not twins_if(explained_share=1.0 - 1.1 * left)  # noise alone would not make that
    assert twins_if(log_evidence=one.log_evidence - 10.0)  # twice the parameters, of which two are not needed
    assert not twins_if(log_evidence=one.log_evidence - 8.1, determined=one.determined)
    assert not twins_if(explained=other.explained + 0.2 * np.linalg.norm(other.explained))
    assert not twins_if(members=())
    single = replace(one, values=one.values[:1], determined=1.0)  # of a single number, where the twin needs several
    assert are_equivalent(single, replace(other, log_evidence=one.log_evidence - 2.9), dof)
    assert not are_equivalent(single, replace(other, log_evidence=one.log_evidence - 3.1), dof)
    nearly = replace(one, overlaps=one.overlaps | {"axis_wobble": 0.998})  # as |q| and three harmonics
    assert not are_equivalent(nearly, other, dof)


def test_a_special_case_comes_first_where_it_says_nearly_as_much(twins: Dataset) -> None:
    screening = screen(calibrate(twins), effects_for(twins))
    ranked = {candidate.name: candidate for candidate in screening.candidates}
    one, other = ranked["transmission_error"], ranked["axis_wobble"]
    wider = replace(other, family=replace(other.family, contains=(one.name,)))

    def first(lead: float, overlap: float) -> tuple[str, int]:
        more = replace(wider, log_evidence=one.log_evidence + lead, overlaps={one.name: overlap})
        best, _, contenders = rank_candidates(replace(screening, candidates=(more, one)))
        return best.name, len(contenders)

    assert first(2.0, 0.8) == (one.name, 0)
    assert first(14.0, 0.97) == (one.name, 0)
    assert first(14.0, 0.8) == (other.name, 0)
    assert not are_equivalent(one, replace(wider, log_evidence=one.log_evidence - 4.0), screening.projected.dof)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("cause", "robot"),
    sweep(
        [
            (cause, robot)
            for cause in ("joint_compliance", "link_bending", "base_compliance")
            for robot in ("rb5", "panda")
        ],
        every_run=[("joint_compliance", "panda"), ("link_bending", "rb5"), ("base_compliance", "rb5")],
    ),
)
def test_without_masses_what_follows_the_load_stays_open_and_the_error_falls(cause: str, robot: str) -> None:
    found = diagnose(simulated((cause, 6.0), robot=robot))
    assert found.verdict == "ambiguous", found.summary()
    assert found.missing == ()
    assert set(found.ambiguous_set) >= LOAD
    before, after = found.steps[0].calibration.after.test, found.calibration.after.test
    assert after.rmse_mm < 0.4 * before.rmse_mm
    assert "To settle it, add mass_kg and com_mm" in found.summary()


def test_what_is_left_beside_an_open_set_is_judged_first() -> None:
    clean = ResidualTests(0.5, 0.05, "dataset", 0.05, (), ())
    large = replace(clean, lack_of_fit_p=1e-9)
    confounded = (ConfoundedSet("a", ("b",), ()),)
    assert concluded(("a",), clean, confounded_sets=confounded).verdict == "ambiguous"
    assert concluded(("a",), large, confounded_sets=confounded).verdict == "unexplained"
    assert concluded(("a",), clean, confounded_sets=confounded, left_to_curves=True).verdict == "unexplained"
