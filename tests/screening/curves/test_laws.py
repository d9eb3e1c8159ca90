"""Laws of joints: their inputs by hand, what is tried, and causes of a simulator that shares no code with calib."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate, diagnose
from calib.dataset.dataset import Poses
from calib.dataset.input_names import HistoryInput, column_input, history_input
from calib.diagnosis.result import Diagnosis
from calib.effects.effect import apply_values, exceeded_bound
from calib.effects.state import RobotState
from calib.models.model_file import load_model
from calib.present.fit.learned import law_phrase, law_sentence, laws_document
from calib.present.results import to_dict
from calib.screening.curves.fitted_curves import fitted_curves
from calib.screening.curves.joint_curves import LearnedCurves, explains_as_much
from calib.screening.curves.law_readings import law_readings
from calib.screening.curves.law_search import law_member, search_laws
from calib.screening.curves.laws import (
    LAW_KINDS,
    LOAD_BY_ANGLE,
    TWO_JOINTS,
    LawForm,
    law_kind,
    law_motions,
    laws_tried,
)
from calib.screening.curves.smooth_joint_error import (
    FormulaModes,
    FormulaTerm,
    SmoothJointError,
    faded_average,
    input_values,
)
from calib.screening.projected_residual import project_residual
from calib.statistics import rms
from tests.support.engine.cases import Case, Simulated, simulate
from tests.support.engine.law_causes import FORMS

NOTHING = Case("null", (), 7, seed=5)


@pytest.fixture(scope="module")
def nothing() -> Simulated:
    """An arm of the second simulator in which nothing is hidden, with payloads, sides and times."""
    return simulate(NOTHING)


@pytest.fixture(scope="module")
def state(nothing: Simulated) -> RobotState:
    robot, poses = nothing.dataset.robot, nothing.dataset.poses
    poses = replace(poses, temperature_c=np.linspace(20.0, 30.0, len(poses)))
    return RobotState.nominal(robot, poses)


# ---- inputs of the way that a joint came ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("travel3", HistoryInput("travel", 2)),
        ("direction12", HistoryInput("direction", 11)),
        ("crept2_240s", HistoryInput("crept", 1, 240, "s")),
        ("lagged1_4poses", HistoryInput("lagged", 0, 4, "poses")),
        ("travel0", None),
        ("crept2", None),
        ("travelling3", None),
        ("lagged1_0poses", None),
    ],
)
def test_a_name_of_the_way_is_read(name: str, parts: HistoryInput | None) -> None:
    assert history_input(name) == parts
    assert column_input(name) == (name if parts is None else f"column {name}")


def test_the_way_is_reckoned_through_all_poses_in_the_order_of_measuring(nothing: Simulated) -> None:
    """By hand, from poses that stand in another order in the table; some of them give the same values."""
    angle = np.array([0.1, 0.4, 0.4, -0.2, 0.0])
    order = np.array([3, 0, 4, 1, 2])  # row k of the table was measured as number order[k]
    few = nothing.dataset.poses.select(np.arange(5))
    q = np.zeros((5, nothing.dataset.robot.n_joints))
    q[:, 1] = angle[order]
    poses = Poses(few.ids, few.role, q, few.setup, few.scan_names, time_s=10.0 * order)
    state = RobotState.nominal(nothing.dataset.robot, poses)

    def at(name: str) -> list[float]:
        values = np.zeros(5)
        values[order] = input_values(state, name)
        return np.round(values, 12).tolist()

    assert at("travel2") == [0.0, 0.3, 0.0, -0.6, 0.2]
    assert at("previous2") == [0.1, 0.1, 0.4, 0.4, -0.2]
    assert at("travelled2") == [0.0, 0.3, 0.3, 0.9, 1.1]
    assert at("direction2") == [0.0, 1.0, 1.0, -1.0, 1.0]  # at rest it keeps the side it came from
    some = np.array([4, 0, 2])
    part = replace(state, poses=poses.select(some))
    for name in ("travel2", "travelled2", "direction2", "lagged2_30s", "crept2_30s", "lagged2_3poses"):
        assert input_values(part, name) == pytest.approx(input_values(state, name)[some], abs=1e-12)
        later = replace(state, poses=poses.measured_later())
        assert not input_values(later, name).any(), name


def test_a_faded_average_obeys_its_differential_equation() -> None:
    """dm/dt = u - m, u held from one time to the next, by small steps."""
    course, waited = np.array([1.0, 3.0, -2.0, 0.5]), np.array([0.3, 1.2, 0.7])
    m, found = 1.0, [1.0]
    for u, wait in zip(course[:-1], waited, strict=True):
        for _ in range(20000):
            m += (u - m) * wait / 20000
        found.append(m)
    assert faded_average(course, waited) == pytest.approx(found, abs=1e-4)


# ---- what is tried --------------------------------------------------------------------------------------------------


def test_every_kind_of_law_is_tried_once_where_its_inputs_are_there(state: RobotState) -> None:
    forms = laws_tried(state)
    assert {form.kind for form in forms} == set(LAW_KINDS)
    assert len({(form.joint, form.modes) for form in forms}) == len(forms)
    bare = RobotState.nominal(
        replace(state.robot, joints=tuple(replace(j, mass_kg=None, com_mm=None) for j in state.robot.joints)),
        replace(state.poses, time_s=None, temperature_c=None, approach=None, payload_kg=None),
    )
    without = {form.kind for form in laws_tried(bare)}
    assert not without & {"load", LOAD_BY_ANGLE, "load of another joint", "direction by load", "time or temperature"}
    assert {"coupling", TWO_JOINTS, "slow recovery", "direction by angle"} <= without


def test_motions_are_those_of_the_effect(state: RobotState) -> None:
    rng = np.random.default_rng(3)
    tried = laws_tried(state)
    forms = [tried[k] for k in rng.choice(len(tried), 60, replace=False)]
    for form, motions in zip(forms, law_motions(state, forms), strict=True):
        member = law_member(form, 1e-3)
        assert member.joint_motions(state) == pytest.approx(motions, rel=1e-12)
        moved = apply_values(member, state, np.full(len(member.parameters), 1e-3)).vector - state.vector
        assert moved[:, state.entry_of_joint(form.joint)] == pytest.approx(1e-3 * motions.sum(axis=1), abs=1e-12)


def test_the_size_of_a_law_is_an_angle_with_a_bound(state: RobotState) -> None:
    modes = FormulaModes("q2", (FormulaTerm("line", width=1.5),), "torque1", 30.0)
    member = SmoothJointError(0, modes, (1e-3,))
    assert member.parameters[0].name == "torque1_x_q2_line_rad"
    assert exceeded_bound(member, member.parameters[0], 0.05, 1e-3) is not None
    assert exceeded_bound(member, member.parameters[0], 0.02, 1e-3) is None


def test_nothing_hidden_gives_no_law(nothing: Simulated) -> None:
    assert search_laws(project_residual(calibrate(nothing.dataset))) is None


def test_laws_take_the_place_of_curves_with_three_times_the_parameters() -> None:
    def learned(parameters: int, log_evidence: float) -> LearnedCurves:
        modes = FormulaModes("q1", tuple(FormulaTerm("kink", place=float(k)) for k in range(parameters)))
        return LearnedCurves((SmoothJointError(0, modes, (1e-3,) * parameters),), log_evidence)

    few = learned(2, 50.0)
    assert explains_as_much(few, 50.0, learned(6, 51.0))
    assert not explains_as_much(few, 50.0, learned(6, 53.0))
    assert not explains_as_much(few, 50.0, learned(5, 51.0))
    assert explains_as_much(few, 50.0, learned(2, 50.0))


# ---- causes of another simulator ------------------------------------------------------------------------------------


def _told(name: str, number: int, seed: int) -> tuple[Simulated, Diagnosis]:
    simulated = simulate(Case("law", (name,), number, seed))
    return simulated, diagnose(simulated.dataset)


def _true_motion(simulated: Simulated) -> tuple[int, np.ndarray]:
    """The joint that the cause moves, from 0, and its error (N,) by the simulator."""
    (cause, size), cell = simulated.causes[0], simulated.cell
    moved = cause.deform(cell, cell.plain, size).joint
    (joint,) = np.flatnonzero(np.any(moved != 0.0, axis=0))
    return int(joint), moved[:, joint]


@pytest.fixture(scope="module")
def rippled() -> tuple[Simulated, Diagnosis]:
    """An arm of which one joint has a wave of 28 a turn that grows with its load."""
    return _told("ripple_under_load", 0, 3)


@pytest.mark.slow
def test_a_wave_that_grows_with_the_load_is_told_with_its_size(rippled: tuple[Simulated, Diagnosis]) -> None:
    simulated, found = rippled
    joint, moved = _true_motion(simulated)
    assert found.verdict == "unexplained"
    assert found.learned.laws is not None
    (law,) = law_readings(found.calibration)
    assert (law.kind, law.joint, law.waves_per_turn) == (LOAD_BY_ANGLE, joint + 1, (28,))
    (curve,) = fitted_curves(found.calibration)
    train = ~simulated.dataset.poses.is_test
    assert curve.rms == pytest.approx(rms(moved[train]), rel=0.05)
    assert law.low < law.size < law.high < law.bound
    test = law.refuted_by
    assert test.sweep.joint == joint + 1
    assert len(set(test.at_poses)) == 2
    assert test.forecast_mm > law.tool_mm > 0.0


@pytest.mark.slow
def test_it_reads_the_same_in_words_and_in_the_document(rippled: tuple[Simulated, Diagnosis]) -> None:
    _, found = rippled
    (law,) = law_readings(found.calibration)
    words = law_sentence(law)
    assert words.startswith(f"Joint {law.joint} errs by a wave of 28 a turn over its own angle, in proportion to")
    assert "To refute it, move joint" in words
    document = json.loads(json.dumps(to_dict(found)))["learned"]["laws"]
    assert document == json.loads(json.dumps(laws_document([law], found.learned.laws)))
    assert document[0]["words"].startswith(words)
    assert document[0]["tried"] > 1000
    assert words in found.summary()
    assert law_phrase(law, begin="joint") in found.summary()


@pytest.mark.slow
def test_it_comes_back_from_its_files(rippled: tuple[Simulated, Diagnosis], tmp_path: Path) -> None:
    simulated, found = rippled
    saved = tmp_path / "model.json"
    found.save(saved)
    poses = simulated.dataset.poses
    read = load_model(saved)
    assert read.predict(poses.q, poses) == pytest.approx(found.predict(poses.q, poses), abs=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "number"), [("wave_of_another", 1), pytest.param("dragged_on", 0, marks=pytest.mark.thorough)]
)
def test_other_laws_are_told_of_the_right_joint(name: str, number: int) -> None:
    simulated, found = _told(name, number, 3)
    joint, _ = _true_motion(simulated)
    told = [(m.joint, law_kind(m.joint, m.modes)) for m in found.learned.members if isinstance(m.modes, FormulaModes)]
    assert (joint, FORMS[name]) in told
    before = found.steps[0].calibration.after.test
    assert found.calibration.after.test.rmse_mm < 0.6 * before.rmse_mm


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(set(FORMS) - {"root_of_angle", "bent_scale", "worn_on_the_way"}))
def test_each_law_is_told_once(name: str) -> None:
    """In one of three arms at least: some sets are too faint, or an effect of the catalogue explains as much."""
    right = 0
    for number in range(3):
        simulated, found = _told(name, number, 17)
        joint, _ = _true_motion(simulated)
        members = found.learned.members if found.learned is not None else ()
        forms = [LawForm(m.joint, m.modes) for m in members if isinstance(m.modes, FormulaModes)]
        right += (joint, FORMS[name]) in [(form.joint, form.kind) for form in forms]
    assert right > 0
