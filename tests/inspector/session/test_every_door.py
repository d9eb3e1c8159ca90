"""Following the page's advice button by button, adding by name and the whole diagnosis end in the same place."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from calib import diagnose
from calib.dataset.dataset import Dataset
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import add_in_turn
from calib.simulation.simulate import simulate_dataset
from inspector.session import transitions as sessions
from inspector.session.session import Session
from tests.support.changed import with_xyz
from tests.support.odd_noise import odd_arm

MOST_PRESSES = 9


def arm(seed: int, *effects: tuple[str, float], robot: str = "rb5") -> Dataset:
    return simulate_dataset(robot, rng=seed, effects=effects, conditions=True, poses=60).dataset


def with_wild_point(dataset: Dataset) -> Dataset:
    xyz_mm = dataset.points.xyz_mm.copy()
    xyz_mm[5] += [1.5, 0.0, -1.0]
    return with_xyz(dataset, xyz_mm)


def followed(dataset: Dataset) -> Session:
    """As someone does who presses the button of each advice, from the link errors on."""
    return to_the_end(sessions.with_screening(sessions.with_calibration(Session(dataset))))


def to_the_end(session: Session) -> Session:
    for _ in range(MOST_PRESSES):
        if session.advice is None:
            return session
        session = sessions.with_advice_followed(session)
        session = session if session.diagnosis is not None else sessions.with_screening(session)
    pytest.fail(f"after {MOST_PRESSES} presses there is still advice: {session.advice}")


def model_of(step: FitStep) -> dict[str, dict[str, float]]:
    return {effect.name: dict(effect.prior_sigmas) for effect in step.selected}


def assert_same_end(session: Session, found: Diagnosis) -> None:
    here = session.diagnosis
    assert (here.verdict, here.missing, here.suspected) == (found.verdict, found.missing, found.suspected)
    assert here.ambiguous_set == found.ambiguous_set
    assert set(model_of(session.steps[-1])) == set(model_of(found.steps[-1]))
    for name, sizes in model_of(found.steps[-1]).items():
        assert model_of(session.steps[-1])[name] == pytest.approx(sizes, rel=1e-6)
    ours, theirs = session.steps[-1].calibration.after, found.calibration.after
    assert ours.test.rmse_mm == pytest.approx(theirs.test.rmse_mm, rel=1e-6)
    assert here.summary() == found.summary()


CASES: dict[str, Callable[[], Dataset]] = {
    "one effect": lambda: arm(3, ("backlash", 4.0)),
    "two effects": lambda: arm(5, ("transmission_error", 4.0), ("thermal_growth", 4.0)),
    "nothing": lambda: arm(8),
    "a wild point beside an effect": lambda: with_wild_point(arm(4, ("joint_compliance", 4.0))),
    "a dent": lambda: arm(1, ("joint_dent", 4.0)),
    "no name, curves": lambda: arm(3, ("rough_gear", 5.0)),
    "depth three times coarser": lambda: odd_arm("deep", 2, ["transmission_error"], sigmas=4.0),
    "a wander like a drift": lambda: odd_arm("wandering", 8),
    "repeats that tell the noise": lambda: odd_arm("deep", 0, repeats=3),
    "a second arm": lambda: arm(9, ("joint_scale", 3.0), ("scanner_drift", 3.0), robot="panda"),
}


@cache
def case(name: str) -> Dataset:
    return CASES[name]()


@pytest.mark.parametrize("name", CASES)
@pytest.mark.thorough
def test_the_advice_followed_to_its_end_is_the_diagnosis(name: str) -> None:
    dataset = case(name)
    assert_same_end(followed(dataset), diagnose(dataset))


@pytest.mark.slow
def test_names_added_in_the_order_of_the_search_are_its_model() -> None:
    dataset = case("two effects")
    found = diagnose(dataset)
    assert len(found.missing) == 2
    steps = add_in_turn(dataset, found.missing)
    assert model_of(steps[-1]) == model_of(found.steps[-1])
    np.testing.assert_allclose(steps[-1].calibration.fit.x, found.calibration.fit.x, rtol=1e-9)
