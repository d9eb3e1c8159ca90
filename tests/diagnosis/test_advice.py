"""What to do next with a model built by hand, and what a parameter means on the arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib import calibrate, screen
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.advice import Advice, advice_on
from calib.diagnosis.diagnose import SearchState, next_move
from calib.diagnosis.moves import AddEffect, LeaveOutPoses, next_effect
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, first_fit
from calib.effects.catalogue import effects_for
from calib.effects.catalogue.joints import JointScale, TransmissionError
from calib.effects.catalogue.loads import JointCompliance, ToolSag
from calib.effects.catalogue.scanner import ScannerDrift
from calib.effects.catalogue.thermal import ThermalGrowth
from calib.effects.effect import Effect, Parameter
from calib.effects.state import RobotState
from calib.present.diagnosis.verdict import advice as advice_words
from calib.present.effects import meaning
from calib.rendering.blocks import plain
from calib.screening.candidates import Screening
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, run_residual_tests
from calib.simulation.simulate import simulate_dataset
from tests.support.changed import with_xyz


def fitted(*effects: str, seed: int = 4) -> tuple[Calibration, Screening, ResidualTests]:
    dataset = simulate_dataset(
        "rb5",
        rng=seed,
        effects=[(name, 4.0) for name in effects],
        conditions=True,
        poses=50,
    ).dataset
    result = calibrate(dataset)
    return result, screen(result, effects_for(dataset)), run_residual_tests(dataset, project_residual(result))


@pytest.fixture(scope="module")
def hidden() -> tuple[Calibration, Screening, ResidualTests]:
    return fitted("transmission_error")


@pytest.fixture(scope="module")
def clean() -> tuple[Calibration, Screening, ResidualTests]:
    return fitted(seed=8)


def judged(dataset: Dataset, *, max_effects: int = 3) -> Advice | Diagnosis:
    """What is to be done with the link errors alone."""
    space = SearchSpace.of(dataset, max_effects=max_effects)
    first = space.ranked(first_fit(space))
    tests = run_residual_tests(dataset, project_residual(first.calibration))
    move = next_move(space, SearchState((first,), tests=tests))
    return move if isinstance(move, Diagnosis) else advice_on(move, tests, first.calibration)


def test_the_effect_that_leads_is_to_be_added(hidden: tuple[Calibration, Screening, ResidualTests]) -> None:
    advice = judged(hidden[0].dataset)
    assert isinstance(advice, Advice)
    assert isinstance(advice.move, AddEffect)
    assert advice.effect == "transmission_error"
    assert "a systematic dependence on" in plain(advice_words(advice))
    assert "(transmission_error) explains it best" in plain(advice_words(advice))


@pytest.mark.slow
def test_causes_that_are_alike_are_not_decided(hidden: tuple[Calibration, Screening, ResidualTests]) -> None:
    space = SearchSpace.of(hidden[0].dataset)
    best = hidden[1].candidates[0]
    twin = replace(best, family=replace(best.family, name="twin"), log_evidence=best.log_evidence - 1.0, overlaps={})
    other = replace(twin, explained=np.where(np.arange(len(twin.explained)) % 3, twin.explained, 0.0))
    doubled = replace(best, overlaps={"twin": 1.0})
    step = replace(first_fit(space), screening=replace(hidden[1], candidates=(doubled, other)))
    move = next_effect(space, step)
    assert isinstance(move, AddEffect)
    assert (move.name, move.on_behalf_of) == ("transmission_error", ("twin",))
    step = replace(step, screening=replace(hidden[1], candidates=(doubled, twin)))
    stands_for_both = next_effect(space, step)
    assert isinstance(stands_for_both, AddEffect)
    assert (stands_for_both.name, stands_for_both.on_behalf_of) == ("transmission_error", ())


@pytest.mark.slow
def test_as_many_effects_as_were_asked_for_are_added(
    hidden: tuple[Calibration, Screening, ResidualTests],
) -> None:
    found = judged(hidden[0].dataset, max_effects=0)
    assert isinstance(found, Diagnosis)
    assert (found.verdict, found.missing) == ("unexplained", ())


@pytest.mark.slow
def test_poses_that_stand_out_are_to_be_left_out(
    clean: tuple[Calibration, Screening, ResidualTests],
) -> None:
    dataset = clean[0].dataset
    xyz_mm = dataset.points.xyz_mm.copy()
    xyz_mm[7] += [0.0, 2.0, 0.0]
    pose = dataset.poses.ids[dataset.points.pose[7]]
    advice = judged(with_xyz(dataset, xyz_mm))
    assert isinstance(advice, Advice)
    assert isinstance(advice.move, LeaveOutPoses)
    assert advice.move.poses == (pose,)
    assert advice.move.diagnosis.verdict == "outliers"
    assert "Leave it out, and measure it again" in plain(advice_words(advice))


def test_parameters_say_what_they_do_on_the_arm(hidden: tuple[Calibration, Screening, ResidualTests]) -> None:
    result = hidden[0]
    poses = result.dataset.poses

    def said(effect: Effect, size: float) -> str:
        return meaning(effect, effect.parameters[0], size, result)

    @dataclass(frozen=True)
    class Mine:
        parameters = (Parameter("share", unit="1", scale=1e-2),)

        def apply(self, state: RobotState, *, share: float) -> RobotState:
            return state

    assert said(TransmissionError(0, 1), 1e-3) == "0.057°"
    torque_nm = np.abs(result.model.state(result.fit.x, poses).gravity_torques_nm[:, 1]).max()
    words = said(JointCompliance(1), 2e-5)
    assert words == f"{np.degrees(2e-5 * torque_nm):.2g}° at {torque_nm:.3g} Nm, stiffness 50 kNm/rad"
    assert said(ThermalGrowth(), 1.2e-5) == "12 µm per metre and kelvin"
    travel = np.degrees(np.ptp(poses.q[:, 0]))
    assert said(JointScale(0), 1e-4) == f"{1e-4 * travel:.2g}° over the {travel:.0f}° of its travel"
    hours = np.ptp(poses.time_s) / 3600 if poses.time_s is not None else 0.0
    assert (
        said(ScannerDrift((0.0, 0.0, 0.0), 1.0, 0.0, 1.0), 1e-5)
        == f"{0.036 * hours:.2g} mm over the {hours:.2g} h measured"
    )
    assert said(ToolSag(), 0.1) == ""  # millimetres speak for themselves
    assert said(Mine(), 0.02) == "2 %"
    assert said(TransmissionError(0, 1), 0.0) == ""
