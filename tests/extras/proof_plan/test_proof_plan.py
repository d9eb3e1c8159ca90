"""A change of one condition that proves which effect is true, on an engine that shares no code with calib."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.poses_csv import poses_frame
from calib.effects.catalogue import effects_for
from calib.errors import CalibError
from calib.extras.proof_plan.proof_plan import ForProof, NextChange, change_for, task_of_diagnosis
from calib.planning.effect_hypotheses import EffectHypothesis, HypothesisSet
from calib.planning.plan import plan_poses
from calib.planning.start import FromFit
from calib.present.plans.plans import plan_headline
from tests.support.engine.cases import robot_of
from tests.support.engine.cell import Cell, draw_cell
from tests.support.paired_cell import ARMS, compliance, proofs_of

PART, SIZE = compliance(1), 25.0  # joint 2 yields by 2.5e-5 rad/Nm


def measured(cell: Cell, payload_kg: np.ndarray | None = None, *, soft: bool = True) -> Dataset:
    """A noisy point at each pose of a cell."""
    n = cell.poses
    role = np.full(n, "train", dtype="<U9")
    role[0] = "reference"
    ids = tuple(f"p{k + 1:02d}" for k in range(n))
    poses = Poses(ids, role, cell.q, np.full(n, ""), tuple(f"{one}.ply" for one in ids), payload_kg=payload_kg)
    causes = [(PART.cause, SIZE)] if soft else []
    xyz_mm = cell.reported(causes)["jig"] + 0.05 * np.random.default_rng(3).standard_normal((n, 3))
    points = Points(np.arange(n), xyz_mm, np.full(n, "jig"))
    return Dataset("soft", robot_of(cell), poses, points, scanner=Scanner(point_sigma_mm=0.05))


@pytest.fixture(scope="module")
def cell() -> Cell:
    drawn = draw_cell(ARMS["UR10e"], np.random.default_rng(6), poses=30, payload=False, paced=True)
    return replace(drawn, payload_kg=np.zeros(30))


@pytest.fixture(scope="module")
def open_set(cell: Cell) -> HypothesisSet:
    """Compliance of joints or bending of links, thought equally likely."""
    calibration = calibrate(measured(cell))
    families = [f for f in effects_for(calibration.dataset) if f.name in ("joint_compliance", "link_bending")]
    hypotheses = [EffectHypothesis.of(candidate) for candidate in screen(calibration, families).candidates]
    return HypothesisSet(calibration, tuple(replace(one, log_evidence=0.0) for one in hypotheses))


@pytest.fixture(scope="module")
def change(open_set: HypothesisSet) -> NextChange:
    found = change_for(open_set, payload_kg=5.0, count=12)
    assert found is not None
    return found


def test_poses_are_measured_again_under_a_payload(open_set: HypothesisSet, change: NextChange) -> None:
    assert (change.change.condition, change.change.before, change.change.after) == ("payload_kg", 0.0, 5.0)
    assert len(change.poses) == len(set(change.again)) == change.pairs == 12
    assert change.assumed  # no column has the payload of the poses measured so far
    assert change.poses.payload_kg is not None
    assert np.all(change.poses.payload_kg == 5.0)
    measured_poses = open_set.calibration.dataset.poses
    again = measured_poses.q[[measured_poses.index(pose) for pose in change.again]]
    assert np.array_equal(change.poses.q, again)


def test_what_is_promised_is_proven(cell: Cell, change: NextChange) -> None:
    assert change.probability > 0.5
    assert change.poses.payload_kg is not None
    n, more = cell.poses, len(change.poses)
    after = replace(
        cell,
        q=np.concatenate([cell.q, change.poses.q]),
        payload_kg=np.concatenate([np.zeros(n), change.poses.payload_kg]),
        temperature_c=np.full(n + more, 22.0),
        time_s=30.0 * np.arange(n + more),
        approach=np.ones((n + more, 6)),
        setup=np.zeros(n + more, dtype=np.int64),
    )
    found = {(proof.effect, proof.joint) for proof in proofs_of(measured(after, after.payload_kg))}
    assert found == {(PART.effect, PART.joint)}


def test_the_plan_has_the_columns_that_are_needed(open_set: HypothesisSet, change: NextChange) -> None:
    criterion = ForProof(change, FromFit(open_set.calibration))
    planned = plan_poses(criterion.start, criterion.count, criterion=criterion, candidates=60)
    told = planned.to_dict()
    assert told["settles"] == planned.power == change.probability
    assert told["change"] == {"condition": "payload_kg", "before": 0.0, "after": 5.0}
    assert sorted(pose["again"] for pose in told["poses"]) == sorted(change.again)
    frame = poses_frame(planned.poses, open_set.calibration.dataset.robot)
    assert frame["payload_kg"].tolist() == [5.0] * 12
    assert "to prove which is true" in plan_headline(planned)
    assert "hang 5 kg on the flange" in planned.summary()


@pytest.mark.thorough
def test_a_heavier_payload_tells_more(open_set: HypothesisSet, change: NextChange) -> None:
    light = change_for(open_set, payload_kg=0.5, count=12)
    assert light is not None
    assert light.probability < change.probability


def test_no_change_is_planned_where_none_moves_the_effects(cell: Cell, open_set: HypothesisSet) -> None:
    calibration = open_set.calibration
    families = [f for f in effects_for(calibration.dataset) if f.name in ("transmission_error", "joint_scale")]
    hypotheses = tuple(EffectHypothesis.of(candidate) for candidate in screen(calibration, families).candidates)
    assert change_for(HypothesisSet(calibration, hypotheses)) is None
    with pytest.raises(CalibError, match="nothing to prove"):
        task_of_diagnosis(diagnose(measured(cell, soft=False)), None, None)
