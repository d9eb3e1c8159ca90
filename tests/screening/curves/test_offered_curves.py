"""Curves that are offered beside the ranking: to whom, in which words, how they are drawn and told in a line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.advice import advice_on
from calib.diagnosis.decision_rules import CURVES_SHARE, MIN_LOG_BAYES_FACTOR, is_convincing, ranking_given_curves
from calib.diagnosis.moves import AddCurves
from calib.diagnosis.search_space import add_in_turn
from calib.effects.effect import apply_values
from calib.fitting.observations import nominal_state
from calib.present.diagnosis.verdict import advice as advice_words
from calib.present.diagnosis.verdict import fault as fault_words
from calib.rendering.blocks import plain
from calib.screening.curves.fitted_curves import fitted_curves, learned_members
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.statistics import rms
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.session import Session
from tests.support.hidden_dataset import write_hidden, write_unnamed


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_unnamed(tmp_path_factory.mktemp("cell"))


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Dataset:
    return load_dataset(folder)


@pytest.fixture(scope="module")
def ranked(folder: Path) -> Session:
    return sessions.with_screening(sessions.with_calibration(measuring.open_session(folder)))


@pytest.fixture(scope="module")
def fitted(dataset: Dataset) -> Calibration:
    return add_in_turn(dataset, [LEARNED])[-1].calibration


@pytest.mark.slow
def test_curves_are_offered_where_no_name_explains_what_is_left(ranked: Session) -> None:
    assert ranked.screening is not None
    assert ranked.curves is not None
    assert not any(map(is_convincing, ranking_given_curves(ranked.screening, ranked.curves).candidates))
    assert ranked.advice.effect == LEARNED
    said = plain(advice_words(ranked.advice))
    assert "joint 1" in said
    assert LEARNED in said


@pytest.mark.slow
def test_a_convincing_name_comes_before_curves(tmp_path: Path) -> None:
    named = sessions.with_screening(sessions.with_calibration(measuring.open_session(write_hidden(tmp_path))))
    assert named.curves is None
    assert named.advice.effect == "transmission_error"


def test_a_cause_of_one_place_or_pose_gives_way_to_curves_that_say_more(ranked: Session) -> None:
    screening, curves = ranked.screening, ranked.curves

    least = (curves.log_evidence - MIN_LOG_BAYES_FACTOR) / CURVES_SHARE

    def stays(name: str, lead: float) -> bool:
        one = next(c for c in screening.candidates if c.name == name)
        one = replace(one, log_evidence=least + lead)
        return ranking_given_curves(replace(screening, candidates=(one,)), curves).candidates == (one,)

    assert stays("joint_step", 1.0)
    assert not stays("joint_dent", -1.0)
    assert stays("joint_scale", -1.0)  # no place, no pose: it names the cause
    assert ranking_given_curves(screening, None) == screening


def test_a_fault_of_one_joint_stays_told_unless_all_joints_say_more(ranked: Session) -> None:
    assert ranked.calibration is not None
    move, fault = ranked.advice.move, ranked.residual_tests.fault
    assert isinstance(move, AddCurves)
    told = plain(advice_words(advice_on(move, ranked.residual_tests, ranked.calibration)))
    assert plain(fault_words(fault)) in told  # the curve is of that joint alone
    (member,) = ranked.curves.members
    both = replace(ranked.curves, members=(member, replace(member, joint=4)), log_evidence=fault.log_evidence + 10.0)
    told = plain(advice_words(advice_on(replace(move, curves=both), ranked.residual_tests, ranked.calibration)))
    assert plain(fault_words(fault)) not in told
    assert "more than noise" in told


def test_a_fitted_curve_is_the_effect_at_the_measured_poses(fitted: Calibration, dataset: Dataset) -> None:
    (curve,) = fitted_curves(fitted)
    (member,) = learned_members(fitted)
    values = fitted.fit.x[-len(member.parameters) :]
    state = nominal_state(dataset)
    moved = apply_values(member, state, values).table[:, member.joint, 3] - state.table[:, member.joint, 3]
    training = dataset.poses.role != "test"
    measured = dataset.poses.q[training, member.joint]
    np.testing.assert_array_equal(curve.measured, np.sort(measured))
    at = np.interp(measured, curve.u, curve.value)
    np.testing.assert_allclose(at, moved, atol=3e-2 * np.abs(moved).max())  # between lines of a fine wave
    assert curve.rms == pytest.approx(rms(moved), rel=1e-6)
    place, value = curve.largest
    assert abs(value) == np.abs(curve.value[curve.inside]).max()
    assert curve.measured[0] <= place <= curve.measured[-1]
    assert not curve.inside[0]
    assert not curve.inside[-1]


@pytest.mark.slow
def test_the_band_is_the_scatter_of_the_fits_parameters(fitted: Calibration) -> None:
    (curve,) = fitted_curves(fitted)
    (member,) = learned_members(fitted)
    own = len(member.parameters)
    covariance = fitted.fit.covariance[-own:, -own:]
    drawn = np.random.default_rng(0).multivariate_normal(fitted.fit.x[-own:], covariance, size=20_000)
    scatter = (member.modes.at(curve.u) @ drawn.T).std(axis=1)
    np.testing.assert_allclose(curve.sigma, scatter, rtol=0.05)


def test_values_are_told_as_people_read_them(fitted: Calibration) -> None:
    (curve,) = fitted_curves(fitted)
    assert (curve.unit, curve.input_unit) == ("mrad", "deg")
    assert curve.scale * 2e-3 == pytest.approx(2.0)
    assert curve.input_scale * np.pi == pytest.approx(180.0)
    over_torque = replace(curve, is_revolute=False, input_unit="Nm")
    assert over_torque.unit == "mm"
    assert (over_torque.scale, over_torque.input_scale) == (1.0, 1.0)
