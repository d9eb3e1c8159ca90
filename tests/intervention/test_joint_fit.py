"""Single poses and differences of pairs fitted with one set of parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import calibrate
from calib.dataset.dataset import Dataset
from calib.intervention.joint_fit import joint_fit
from calib.intervention.proof import interventions_of
from tests.support.changed import with_xyz
from tests.support.paired_cell import ARMS, compliance, draw_pairs, measured, size_of

NAME = "joint_compliance.J2.c_rad_per_nm"


def soft(misfit_mm: float = 0.0) -> tuple[Dataset, float]:
    """Pairs of an arm with a soft joint 2, and by how much that yields, rad/Nm.

    misfit_mm: size of a smooth function of the joints that no effect explains, equal at both poses of a pair.
    """
    rng = np.random.default_rng(0)
    cell = draw_pairs(ARMS["RB5"], rng, 40)
    cause = compliance(1).cause
    size = size_of(cell, cause, 0.2)
    made = measured(cell, [(cause, size)], rng, test_places=12)
    turns, phase = 1.5 * rng.standard_normal((6, 6)), rng.uniform(0.0, 2.0 * np.pi, 6)
    missed_mm = misfit_mm * np.sin(cell.q @ turns.T + phase) @ rng.standard_normal((6, 3)) / np.sqrt(3.0)
    return with_xyz(made, made.points.xyz_mm + missed_mm), 1e-6 * size


def test_what_is_proven_lowers_the_held_out_error_of_single_poses() -> None:
    made, size = soft(misfit_mm=0.3)
    links = calibrate(made)
    found = joint_fit(links, interventions_of(links))
    assert (found.added, found.dropped) == (("joint_compliance",), ())
    assert found.calibration.after.test.rmse_mm < 0.6 * links.after.test.rmse_mm
    value = found.calibration.to_frame().set_index("name").loc[NAME, "value"]
    assert abs(value - size) < 0.05 * size
    assert found.misfit > 3.0  # of 0.3 mm, beside a noise of 0.05 mm
    assert found.weight_of_single < 0.1


def test_without_a_misfit_it_is_the_fit_of_all_poses_and_counts_none_twice() -> None:
    made, _ = soft()
    links = calibrate(made)
    interventions = interventions_of(links)
    found = joint_fit(links, interventions)
    alone = calibrate(made, effects=interventions[0].proven_members[0]).to_frame().set_index("name").loc[NAME]
    together = found.calibration.to_frame().set_index("name").loc[NAME]
    assert found.weight_of_single > 0.5
    assert abs(together["value"] - alone["value"]) < alone["sigma"]
    assert together["sigma"] > 0.9 * alone["sigma"]


def test_an_effect_that_pairs_refute_leaves_the_model() -> None:
    made, _ = soft()
    links = calibrate(made)
    interventions = interventions_of(links)
    wrong = calibrate(made, effects=["base_compliance"])
    found = joint_fit(wrong, interventions, ["base_compliance"])
    assert (found.added, found.dropped) == (("joint_compliance",), ("base_compliance",))
    assert found.calibration.model.family_names == ("joint_compliance",)


def test_there_is_none_without_a_proof() -> None:
    assert joint_fit(calibrate(soft()[0]), ()) is None


def test_masses_that_nobody_told_are_fitted_beside_what_is_proven() -> None:
    made, size = soft(misfit_mm=0.3)
    joints = tuple(replace(joint, mass_kg=None, com_mm=None) for joint in made.robot.joints)
    links = calibrate(replace(made, robot=replace(made.robot, joints=joints)))
    found = joint_fit(links, interventions_of(links))
    assert found.calibration.after.test.rmse_mm < 0.7 * links.after.test.rmse_mm
    value = found.calibration.to_frame().set_index("name").loc[NAME]
    assert abs(value["value"] - size) < 0.05 * size
