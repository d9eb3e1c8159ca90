"""A kicked tripod is told as that, between which poses, and no table, correction or budget holds it against the arm."""

from __future__ import annotations

import numpy as np
import pytest

from calib import diagnose, frames
from calib.calibration.calibrate import fit_measured
from calib.dataset.dataset import Dataset
from calib.diagnosis.headline import headline_of
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import available_family
from calib.errors import DatasetError
from calib.models.exported_table import exported_table
from calib.present.diagnosis.actions import plain_verdict, what_to_do
from calib.present.diagnosis.diagnosis import diagnosis_document
from calib.present.results import headline
from tests.support.changed import with_poses
from tests.support.engine.cases import Case, simulate


@pytest.fixture(scope="module")
def kicked() -> Dataset:
    """A tripod that was kicked, by a simulator with its own kinematics, and no test pose at the kick."""
    return simulate(Case("kick", ("scanner_step",), 3, sigmas=(12.0,))).dataset


@pytest.fixture(scope="module")
def found(kicked: Dataset) -> Diagnosis:
    return diagnose(kicked)


def test_it_is_told_between_which_poses_and_as_no_error_of_the_arm(kicked: Dataset, found: Diagnosis) -> None:
    assert found.missing == ("scanner_step",)
    move = found.instrument_moved[0]
    ids = kicked.poses.ids
    assert ids.index(move.after) < ids.index(move.before)
    assert f"The instrument was moved between {move.after} and {move.before}: that is no error" in headline(found)
    document = diagnosis_document(found, None)
    assert document["instrument_moved"][0].keys() == {"after", "before", "turn_mrad", "shift_mm"}
    parts = {share["cause"]: share["of"] for share in document["budget"]}
    assert parts["scanner_step"] == "instrument"
    assert parts["geometry"] == "arm"
    way, table = headline_of([step.calibration for step in found.steps]), exported_table(found.calibration)
    advice = what_to_do(way, table, None, found, None, ())
    assert any(f"--new-setup {move.before}" in line for line in advice)
    assert not any("correct the joint targets" in line or "mend the cause" in line for line in advice)
    assert "is no error of the arm: step of the scanner" in plain_verdict(way, found)


def test_tables_and_corrections_are_those_of_a_second_setup(kicked: Dataset, found: Diagnosis) -> None:
    apart = kicked.with_new_setups([found.instrument_moved[0].before])
    split = fit_measured(apart, found.calibration.options)
    table = exported_table(found.calibration)
    assert table.left_out == ()
    one, other = table.full.fit.by_name, split.fit.by_name
    assert all(abs(one[name][0] - value) < sigma for name, (value, sigma) in other.items())
    q, conditions = kicked.poses.q, kicked.poses
    arm_mm, other_mm = found.calibration.predict(q, conditions), split.predict(q, conditions)
    apart_mm = arm_mm - frames.apply(frames.best_fit_transform(other_mm, arm_mm), other_mm)
    assert np.abs(apart_mm).max() < 0.01  # 0.5 mm and more where the kick counts
    first = [np.abs(fit.correct(q, conditions).change[:, 0]).max() for fit in (found.calibration, split)]
    assert first[0] < first[1] + np.radians(0.02)


def test_a_new_setup_leaves_nothing_of_it(kicked: Dataset, found: Diagnosis) -> None:
    apart = diagnose(kicked.with_new_setups([found.instrument_moved[0].before]))
    assert "scanner_step" not in (*apart.missing, *apart.suspected)
    assert apart.instrument_moved == ()


def test_a_test_pose_between_the_two_sides_counts_for_neither(kicked: Dataset, found: Diagnosis) -> None:
    move = found.instrument_moved[0]
    role = kicked.poses.role.copy()
    beside = kicked.poses.index(move.before) - 1
    role[beside] = "test"  # measured before the kick, which no fit can know
    dataset = with_poses(kicked, role=role)
    step = next(m for m in available_family(dataset, "scanner_step").members if m.start.pose == move.before)
    sigmas = found.calibration.model.prior_sigmas
    fit = fit_measured(dataset, found.calibration.options, effects=[step], prior_sigmas=sigmas)
    tested = fit.after.is_tested
    assert not tested[beside]
    assert tested.sum() == np.sum(role == "test") - 1
    error_mm = np.linalg.norm(fit.after.error_mm, axis=1)
    off = float(error_mm[fit.after.pose == beside].max())
    assert fit.after.test.max_mm < off


def test_a_setup_that_cannot_begin_there_is_refused(kicked: Dataset) -> None:
    with pytest.raises(DatasetError, match="no pose named 'nobody'"):
        kicked.with_new_setups(["nobody"])
    with pytest.raises(DatasetError, match="is the first of its setup"):
        kicked.with_new_setups([kicked.poses.ids[0]])
