"""What yields between two parts is proven together where the poses cannot tell the parts apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose
from calib.dataset.dataset import Dataset
from calib.dataset.further_columns import FurtherColumns
from calib.diagnosis.contradictions import contradictions
from calib.effects.catalogue.loads import LinkBending
from calib.effects.effect import family_name
from calib.intervention.differences import differences_of
from calib.intervention.pairs import find_pairs
from calib.intervention.proof import Intervention, candidates_of, interventions_of, with_masses
from calib.planning.discrimination import next_poses
from calib.planning.effect_hypotheses import hypothesis_sets
from calib.present.diagnosis.interventions import intervention_sentences, proven_document
from calib.rendering.blocks import plain
from tests.support.changed import with_poses, with_xyz
from tests.support.paired_cell import ARMS, Member, compliance, draw_pairs, measured, with_joints_held

SOFT = 7.5e-5  # rad/Nm
TWINS = [("joint_compliance", 2), ("link_bending", 1)]


def recorded(part: Member | None, *, held: bool = True, noise_mm: float = 0.1, seed: int = 1) -> Dataset:
    """Runs of an arm with a short link 1 under 0, 1.25 and 2.5 kg, of which joints 1 and 2 alone move."""
    rng = np.random.default_rng([seed, 48])
    arm = ARMS["Panda"]
    (a, alpha, _, theta, beta), *rows = arm.rows
    arm = replace(arm, rows=((a, alpha, 100.0, theta, beta), *rows), payload_com_mm=(0.0, 0.0, 90.0))
    cell = draw_pairs(arm, rng, 60, (0.0, 1.25, 2.5))
    cell = with_joints_held(cell, (0.0, -1.2, 0.0, 1.4, 0.0)) if held else cell
    return measured(cell, [] if part is None else [(part.cause, 1e6 * SOFT)], rng, noise_mm=noise_mm)


def proven(made: Dataset) -> Intervention:
    (found,) = interventions_of(calibrate(made))
    return found


@pytest.fixture(scope="module")
def soft() -> Dataset:
    return recorded(compliance(1))


def test_parts_that_these_poses_cannot_tell_apart_are_proven_together(soft: Dataset) -> None:
    found = proven(soft)
    (proof,) = found.proofs
    assert sorted((one.effect, one.joint) for one in proof.alike) == TWINS
    assert (proof.effect, proof.joint, proof.value) == ("joint_compliance", 2, proof.alike[0].value)
    assert all(abs(one.value - SOFT) < 4.0 * one.sigma < 0.5 * SOFT for one in proof.alike)
    ((first, other),) = found.proven_members
    assert {family_name(first), family_name(other)} == {effect for effect, _ in TWINS}


def test_poses_of_all_joints_tell_them_apart_and_a_stiff_arm_proves_nothing() -> None:
    (proof,) = proven(recorded(compliance(1), held=False)).proofs
    assert (proof.effect, proof.joint, proof.alike) == ("joint_compliance", 2, ())
    stiff = proven(recorded(None))
    assert (stiff.proofs, stiff.open_causes) == ((), ())


def test_a_set_is_told_by_its_place_and_split_by_a_plan(soft: Dataset) -> None:
    found = diagnose(soft, max_steps=1)
    (told,) = proven_document(found)["proven"]
    assert [(one["effect"], one["joint"]) for one in told["set"]] == TWINS
    assert all(set(one) == {"effect", "joint", "parameter", "value", "sigma", "unit"} for one in told["set"])
    words = " ".join(map(plain, intervention_sentences(found)))
    assert "the place between link 1 and joint 2 yields, by 7." in words
    assert "cannot tell link bending of joint 1 and joint compliance of joint 2 apart" in words
    together = hypothesis_sets(found)[-1]
    assert set(together.names) == {effect for effect, _ in TWINS}
    assert next_poses(found).discrimination is not None


def test_a_fit_that_has_the_other_part_of_a_set_contradicts_nothing(soft: Dataset) -> None:
    (proof,) = proven(soft).proofs
    fitted = calibrate(soft, effects=[LinkBending(0)])
    assert contradictions([proof], fitted, ["link_bending"], ["link_bending", "joint_compliance"]) == ()


def test_what_the_joints_alone_decide_is_no_rival_however_noisy_their_encoders(soft: Dataset) -> None:
    noisy = np.degrees(soft.poses.q[:, 0]) + 0.01 * np.random.default_rng(0).standard_normal(len(soft.poses))
    read = with_poses(soft, extra=FurtherColumns({"link_q1_deg": noisy}))
    fit = calibrate(read)
    robot = with_masses(fit.model.calibrated_robot(fit.fit.x))
    candidates = candidates_of(differences_of(fit.dataset, find_pairs(fit.dataset)[0], robot), fit.dataset)
    assert not {"axis_wobble", "transmission_error", "joint_scale"} & {family_name(c.member) for c in candidates}


def test_a_proof_does_not_hang_on_one_place() -> None:
    """A stiff arm, but for one place, where everything was pushed aside."""
    made = recorded(None, held=False, noise_mm=0.05)
    pushed = np.isin(made.poses.ids, ["p07_run2", "p07_run3"])[made.points.pose]
    for push_mm in (0.5, 1.0, 3.0):
        moved = made.points.xyz_mm + np.where(pushed[:, None], [0.3 * push_mm, 0.0, -push_mm], 0.0)
        assert proven(with_xyz(made, moved)).proofs == ()
