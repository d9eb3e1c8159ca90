"""Causes that an independent engine made, proven by differences of paired poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, frames
from calib.dataset.dataset import Dataset
from calib.diagnosis.contradictions import contradictions
from calib.intervention.pairs import find_pairs
from calib.intervention.proof import Proof, interventions_of
from calib.present.diagnosis.interventions import intervention_sections
from calib.rendering.blocks import FigurePlace
from inspector.figures.results.places import draw
from tests.support.changed import with_xyz
from tests.support.engine.joint_causes import moves
from tests.support.engine.load_causes import thermal_growth
from tests.support.paired_cell import ARMS, Member, base, bending, compliance, draw_pairs, measured, proofs_of, size_of

KEYS = {"effect", "joint", "parameter", "value", "sigma", "unit", "pairs", "condition"}


def softened(
    arm: str = "UR10e", part: Member | None = None, *, seed: int = 3, times_noise: float = 6.0, **options: object
) -> tuple[Dataset, float]:
    """Dataset of an arm with one soft part, and by how much that yields, rad/Nm."""
    rng = np.random.default_rng(seed)
    loads = options.pop("loads_kg", (0.0, 2.0))
    cell = draw_pairs(ARMS[arm], rng, 20, loads)  # type: ignore[arg-type]
    cause = (part or compliance(1)).cause
    size = size_of(cell, cause, times_noise * 0.05)
    return measured(cell, [(cause, size)], rng, **options), 1e-6 * size  # type: ignore[arg-type]


def only(proofs: tuple[Proof, ...]) -> Proof:
    (proof,) = proofs
    return proof


@pytest.mark.parametrize("arm", sorted(ARMS))
@pytest.mark.parametrize("part", [compliance(1), compliance(2)], ids=["joint 2", "joint 3"])
def test_a_soft_joint_is_proven_with_its_value(arm: str, part: Member) -> None:
    made, size = softened(arm, part, times_noise=10.0)
    proof = only(proofs_of(made))
    assert (proof.effect, proof.joint, proof.condition) == (part.effect, part.joint, "payload_kg")
    assert abs(proof.value - size) < 4.0 * proof.sigma < 0.5 * size
    assert (proof.pairs, proof.unit) == (20, "rad/Nm")


def test_a_bending_link_and_a_soft_pedestal_are_proven() -> None:
    made, size = softened(part=bending(1))
    proof = only(proofs_of(made))
    assert (proof.effect, proof.joint) == ("link_bending", 2)
    assert abs(proof.value - size) < 4.0 * proof.sigma
    made, size = softened(part=base((1.0, 0.6)), times_noise=12.0)
    by_axis = {proof.parameter: proof for proof in proofs_of(made)}
    for name, share in (("cx_rad_per_nm", 1.0), ("cy_rad_per_nm", 0.6)):
        assert by_axis[name].effect == "base_compliance"
        assert by_axis[name].joint is None
        assert abs(by_axis[name].value - share * size) < 4.0 * by_axis[name].sigma


def test_masses_of_the_links_are_not_needed() -> None:
    made, size = softened(masses=False)
    bare = replace(made, robot=replace(made.robot, tool=replace(made.robot.tool, payload_com_mm=(30.0, -20.0, 90.0))))
    proof = only(proofs_of(bare))
    assert (proof.effect, proof.joint) == ("joint_compliance", 2)
    assert abs(proof.value - size) < 4.0 * proof.sigma


def test_three_loads_count_no_difference_twice() -> None:
    made, size = softened(loads_kg=(0.0, 1.0, 2.0))
    proof = only(proofs_of(made))
    assert proof.pairs == 40
    assert abs(proof.value - size) < 4.0 * proof.sigma
    pair, _ = softened(loads_kg=(0.0, 2.0))
    # The load in the middle tells nothing of a slope; its noise is not new knowledge of it either.
    assert proof.sigma > 0.8 * only(proofs_of(pair)).sigma


def test_nothing_is_proven_where_nothing_gives_way() -> None:
    rng = np.random.default_rng(0)
    for arm in ARMS.values():
        (found,) = interventions_of(calibrate(measured(draw_pairs(arm, rng), [], rng)))
        assert found.proofs == ()


def test_too_few_pairs_prove_nothing() -> None:
    rng = np.random.default_rng(1)
    cell = draw_pairs(ARMS["UR10e"], rng, 20)
    made = measured(cell, [(compliance(1).cause, 50.0)], rng)
    kept = [pose for pose in made.poses.ids if pose.endswith("_run2")][:17]
    assert proofs_of(made)
    assert proofs_of(made.leave_out(kept)) == ()


def test_held_out_pairs_are_not_fitted() -> None:
    made, _ = softened(test_places=6)
    (found,) = interventions_of(calibrate(made))
    assert (found.pairs, found.held_out) == (14, 6)
    assert found.proofs


def test_a_cause_that_held_out_pairs_refute_is_not_proven() -> None:
    """The arm is stiff at the test poses: the weight was hung on at the others alone."""
    made, _ = softened(test_places=6)
    assert proofs_of(made)
    first = [made.poses.index(pose.replace("_run2", "_run1")) for pose in made.poses.ids]
    xyz_mm = np.where(made.poses.is_test[:, None], made.points.xyz_mm[first], made.points.xyz_mm)
    assert proofs_of(with_xyz(made, xyz_mm)) == ()


# ---- what must not matter -------------------------------------------------------------------------------------------


def test_the_order_of_a_pair_changes_nothing_but_the_sign_of_the_difference() -> None:
    made, _ = softened()
    rows = np.concatenate([np.arange(20, 40), np.arange(20)])
    poses = made.poses.select(rows)
    place = np.argsort(rows)[made.points.pose]
    turned = replace(made, poses=replace(poses, order=np.arange(40.0)), points=replace(made.points, pose=place))
    here, there = (only(proofs_of(one)) for one in (made, turned))
    assert there.value == pytest.approx(here.value, rel=1e-6)
    assert there.sigma == pytest.approx(here.sigma, rel=1e-6)
    assert find_pairs(turned)[0].pairs[0].changes == find_pairs(made)[0].pairs[0].changes


@pytest.mark.parametrize("is_told", [True, False])
def test_an_instrument_that_was_moved_between_the_loads_changes_nothing(is_told: bool) -> None:
    made, _ = softened()
    loaded = made.poses.payload_kg == 2.0  # one point a pose
    far = 1.0 if is_told else 1e-3  # without a word it moves by a knock
    turn = frames.rotation_from_rotvec(far * np.array([0.2, -0.3, 0.5]))
    moved = frames.make_transform(turn, far * np.array([300.0, 0.0, 90.0]))
    xyz_mm = np.where(loaded[:, None], frames.apply(moved, made.points.xyz_mm), made.points.xyz_mm)
    setup = np.where(loaded, "b", "a") if is_told else made.poses.setup
    other = replace(made, poses=replace(made.poses, setup=setup), points=replace(made.points, xyz_mm=xyz_mm))
    here, there = (only(proofs_of(one)) for one in (made, other))
    assert (there.effect, there.joint) == (here.effect, here.joint)
    assert abs(there.value - here.value) < 0.1 * here.sigma


# ---- other conditions -----------------------------------------------------------------------------------------------


def test_backlash_is_proven_by_coming_from_the_other_side() -> None:
    rng = np.random.default_rng(4)
    cell = draw_pairs(ARMS["UR10e"], rng, 20, (0.0, 0.0))
    side = rng.choice([-1.0, 1.0], (20, 6))
    cell = replace(cell, approach=np.concatenate([side, -side]))
    shares = np.eye(6)[2]
    cause = moves("backlash", shares, lambda c, here, j: c.approach[:, j])
    found = proofs_of(measured(cell, [(cause, 4.0)], rng))
    proof = only(found)
    assert (proof.effect, proof.joint, proof.condition) == ("backlash", 3, "approach3")
    assert abs(proof.value - 8e-4) < 4.0 * proof.sigma  # b / 2 is 4 times 0.1 mrad


def test_growth_with_warmth_is_proven_by_a_warm_run() -> None:
    rng = np.random.default_rng(5)
    cell = draw_pairs(ARMS["RB5"], rng, 20, (0.0, 0.0))
    cell = replace(cell, temperature_c=np.repeat([20.0, 32.0], 20) + 0.2 * rng.standard_normal(40))
    proof = only(proofs_of(measured(cell, [(thermal_growth(cell, rng), 3.0)], rng)))
    assert (proof.effect, proof.condition) == ("thermal_growth", "temperature_c")
    assert abs(proof.value - 3e-5) < 4.0 * proof.sigma


# ---- what is told ---------------------------------------------------------------------------------------------------


def test_a_diagnosis_tells_what_is_proven() -> None:
    made, _ = softened(test_places=5)
    found = diagnose(made)
    (told,) = found.to_dict()["proven"]
    assert set(told) == KEYS
    assert (told["effect"], told["joint"], told["pairs"]) == ("joint_compliance", 2, 15)
    summary = found.summary()
    assert "Proven by 15 pairs, hanging 2 kg on the flange: joint compliance (joint_compliance) of joint 2" in summary
    assert "5 pairs of held-out test poses" in summary
    assert "contradicts" not in summary
    together = found.to_dict()["joint_fit"]
    assert [(value["effect"], value["joint"]) for value in together["values"]] == [("joint_compliance", 2)]
    assert "Single poses and differences fitted together" in summary
    (section,) = intervention_sections(found)
    (place,) = (block for block in section.blocks if isinstance(block, FigurePlace))
    assert "held-out pairs" in draw(place, "moved")  # as a report has it


def test_a_proof_that_contradicts_the_fit_is_told() -> None:
    made, _ = softened()
    found = diagnose(made)
    proof = only(found.proven)
    last = found.calibration
    other = replace(proof, value=proof.value + 10.0 * proof.sigma)
    assert contradictions([proof], last, found.missing, ["link_bending"]) == ()
    (against,) = contradictions([other], last, found.missing, ["link_bending"])
    assert against.fitted is not None
    geometry = found.steps[0].calibration  # a fit that named another effect
    (against,) = contradictions([proof], geometry, ["link_bending"], ["link_bending", "joint_compliance"])
    assert against.instead == ("link_bending",)
    assert contradictions([proof], geometry, ["transmission_error"], ["link_bending"]) == ()


def test_pairs_that_settle_nothing_say_what_stays_open() -> None:
    made, _ = softened("RB5", seed=1, times_noise=1.5)
    (found,) = interventions_of(calibrate(made))
    assert found.proofs == ()
    assert len(found.open_causes) > 1
    told = diagnose(made)
    assert told.to_dict()["proven"] == []
    assert "do not settle what moves the arm" in told.summary()


def test_a_dataset_without_pairs_tells_nothing_of_them() -> None:
    made, _ = softened()
    singles = made.leave_out([pose for pose in made.poses.ids if pose.endswith("_run2")])
    found = diagnose(singles)
    assert found.interventions == ()
    assert found.to_dict()["proven"] == []
    assert "pairs" not in found.summary()
