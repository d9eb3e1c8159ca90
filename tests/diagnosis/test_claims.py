"""What a diagnosis claims is missing, and what it only suspects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import pytest

from calib import calibrate, diagnose, screen
from calib.dataset.dataset import Dataset
from calib.diagnosis.decision_rules import refusal
from calib.diagnosis.effect_selection import SelectedEffect, calibrate_with
from calib.diagnosis.verdict import ConfoundedSet, Refusal
from calib.effects.base import Parameter
from calib.effects.catalogue import effects_for
from calib.effects.effect import families_from
from calib.effects.state import RobotState
from calib.screening.noise_search import AddedEffect
from calib.screening.projected_residual import ProjectedResidual
from calib.screening.residual_tests import InputTest, ResidualTests, asked_of_joints
from calib.screening.scan_statistic import Channel
from calib.simulation.simulate import simulate_dataset
from tests.support.findings import concluded
from tests.support.sweeps import sweep


def simulated(effects: list[tuple[str, float]], seed: int = 3) -> Dataset:
    return simulate_dataset("rb5", rng=seed, effects=effects, conditions=True, poses=64).dataset


def with_unknown_cause(dataset: Dataset, size_mm: float = 0.3) -> Dataset:
    """The measured points moved along the scanner's x with joint 2: no effect of the catalogue does that."""
    points = dataset.points
    along = size_mm * np.sin(3.0 * dataset.poses.q[points.pose, 1])
    return dataset.with_points(replace(points, xyz_mm=points.xyz_mm + along[:, None] * np.array([1.0, 0.0, 0.0])))


@pytest.mark.thorough
def test_names_beside_an_unexplained_rest_are_suspected_everywhere_and_claimed_nowhere() -> None:
    found = diagnose(with_unknown_cause(simulated([("joint_compliance", 5.0)])))
    assert found.verdict == "unexplained"
    assert found.missing == ()
    assert "joint_compliance" in found.suspected
    assert [step.effect for step in found.steps if step.candidate] == [None, *found.suspected][1:]
    assert found.calibration.sigma_mm < found.steps[0].calibration.sigma_mm  # they stay in the model
    said = found.summary()
    assert "Suspected: joint compliance" in said
    assert "Missing: " not in said
    assert "suspected, not confirmed" in said
    assert "ismantle" in said
    document = found.to_dict()
    assert (document["missing"], document["suspected"]) == ([], list(found.suspected))


@dataclass(frozen=True)
class Expansion:
    """Every length of the arm grows with temperature: the catalogue's thermal growth under another name."""

    parameters = (Parameter("kappa_per_k", unit="1/K", scale=1e-5),)
    name = "expansion"

    def apply(self, state: RobotState, *, kappa_per_k: float) -> RobotState:
        from calib.effects.catalogue.thermal import ThermalGrowth

        own = ThermalGrowth()
        return own.apply(state, **{own.parameters[0].name: kappa_per_k})


@pytest.mark.thorough
def test_a_clear_first_effect_stays_claimed_beside_a_tied_second() -> None:
    dataset = simulated([("joint_compliance", 8.0), ("thermal_growth", 3.0)])
    found = diagnose(dataset, user_effects=families_from((Expansion(),)))
    assert found.verdict == "ambiguous"
    assert set(found.ambiguous_set) == {"thermal_growth", "expansion"}
    assert (found.missing, found.suspected) == (("joint_compliance",), ())
    worse = diagnose(with_unknown_cause(dataset), user_effects=families_from((Expansion(),)))
    assert worse.missing == ()
    assert "joint_compliance" in worse.suspected
    assert "Suspected: joint compliance" in worse.summary()


AS_A_DRIFT = AddedEffect("backlash", 5.0, cast(ProjectedResidual, None))


def left(residual_mm: float, noise_from: str = "dataset") -> ResidualTests:
    return ResidualTests(0.5, 0.05, noise_from, residual_mm, (), ())


@pytest.mark.parametrize(
    ("tests", "more", "verdict", "claimed"),
    [
        (left(0.05), {}, "named", True),
        (replace(left(0.05), outlier_poses=("p1",)), {}, "outliers", True),
        (replace(left(0.05), lack_of_fit_p=1e-9), {}, "unexplained", False),
        (left(0.05), {"no_more_than_drift": AS_A_DRIFT}, "unexplained", False),
        (left(0.05), {"far_test_poses": ("p1", "p2", "p3")}, "unexplained", False),
        (replace(left(0.05), outlier_poses=("p1",)), {"far_test_poses": ("p1", "p2", "p3")}, "unexplained", False),
        (left(0.05), {"left_to_curves": True}, "unexplained", False),
        (left(0.05), {"implausible": "the points do not belong to these poses"}, "unexplained", False),
    ],
)
def test_what_is_claimed(tests: ResidualTests, more: dict[str, object], verdict: str, claimed: bool) -> None:
    conclusion = concluded(("backlash",), tests, **more)
    assert conclusion.verdict == verdict
    assert (conclusion.missing, conclusion.suspected) == ((("backlash",), ()) if claimed else ((), ("backlash",)))
    assert conclusion.standing("backlash") == ("claimed" if claimed else "suspected")
    assert conclusion.ambiguous_set == ()


@pytest.mark.parametrize(
    ("tests", "more", "claimed"),
    [
        (left(0.069), {}, True),
        (left(0.071), {}, False),
        (left(0.071, "fit"), {}, True),
        (left(0.05), {"no_more_than_drift": AS_A_DRIFT}, False),
    ],
)
def test_what_is_claimed_where_one_effect_is_fitted_on_behalf_of_others_that_it_does_not_lead(
    tests: ResidualTests, more: dict[str, object], claimed: bool
) -> None:
    undecided = ConfoundedSet("a", ("b",), (), is_undecided=True)
    added = ("backlash", "a", "tool_sag")  # what is added beside it may stand for what the other would leave
    conclusion = concluded(added, tests, on_behalf_of={"a": ("b",)}, confounded_sets=(undecided,), **more)
    assert (conclusion.verdict, conclusion.ambiguous_set) == ("ambiguous", ("a", "b"))
    assert conclusion.missing == (("backlash",) if claimed else ())
    assert conclusion.suspected == (("tool_sag",) if claimed else ("backlash", "tool_sag"))


def test_an_effect_that_stands_for_others_is_open_and_others_are_claimed_beside_it() -> None:
    confounded = ConfoundedSet("joint_compliance", ("link_bending",), ())
    conclusion = concluded(("joint_compliance", "backlash"), left(0.05), confounded_sets=(confounded,))
    assert conclusion.missing == ("backlash",)
    assert conclusion.ambiguous_set == ("joint_compliance", "link_bending")
    assert [conclusion.standing(name) for name in ("joint_compliance", "tool_sag")] == ["open", None]


@pytest.mark.parametrize(
    ("p_values", "residual_mm", "noise_from", "structured"),
    [
        ((0.006, 0.3), 0.054, "dataset", False),  # as one input of a hundred datasets of noise
        ((0.006, 0.3), 0.054, "fit", True),
        ((0.006, 0.3), 0.06, "dataset", True),
        ((0.006, 0.008), 0.054, "dataset", False),  # of inputs that go together, two are no more than one
        ((0.001, 0.3), 0.054, "dataset", True),
    ],
)
def test_a_weak_pattern_in_a_residual_of_the_noises_size_revokes_no_name(
    p_values: tuple[float, ...], residual_mm: float, noise_from: str, structured: bool
) -> None:
    inputs = tuple(InputTest(f"q{k}", p, Channel(0)) for k, p in enumerate(p_values))
    tests = replace(left(residual_mm, noise_from), inputs=inputs)
    assert bool(tests.structured) == structured
    assert concluded(("backlash",), tests).verdict == ("unexplained" if structured else "named")


def test_a_pattern_on_the_joint_that_was_named_is_asked_for_there_alone() -> None:
    """As one of thirty inputs it is chance; an effect that is nearly the cause leaves it on its own joint."""
    inputs = (InputTest("q2", 0.024, Channel(1), 0.001), InputTest("q3", 0.3, Channel(2), 0.02))
    tests = replace(left(0.054), inputs=inputs)
    assert asked_of_joints(tests, ()) == tests
    assert asked_of_joints(tests, (2,)) == tests
    assert asked_of_joints(tests, (1,)).structured == ("q2",)
    assert [test.p_value for test in asked_of_joints(tests, (1, 2)).inputs] == [0.002, 0.3]


@pytest.mark.slow
def test_a_further_effect_has_to_help_poses_that_its_fit_did_not_see() -> None:
    dataset = simulated([("transmission_error", 3.0)])
    before = calibrate(dataset)
    screening = screen(before, effects_for(dataset))
    best = screening.candidates[0]
    after = calibrate_with(dataset, (SelectedEffect.of(best),), start=before)
    useless = replace(best, cv_rmse_mm=screening.cv_rmse_mm)
    for further in (False, True):
        assert refusal(best, screening, before, after, further=further, strict=further) is None
        worse = refusal(
            best, screening, after, before, further=further, strict=further
        )  # the test poses get much worse
        assert worse.why == "test poses"
        assert (refusal(useless, screening, before, after, further=further, strict=further) is not None) is further
    is_test = before.after.is_test[before.after.pose]
    grows = np.argsort(np.linalg.norm(before.after.error_mm[is_test], axis=1)) % 2 == 0
    error_mm = before.after.error_mm.copy()
    error_mm[is_test] *= np.where(grows, 1.1, 0.95)[:, None]  # worse on average, within the scatter
    little = replace(before, after=replace(before.after, error_mm=error_mm))
    refused = refusal(best, screening, before, little, further=True, strict=True)
    assert refused.why == "test poses"
    nowhere = refusal(
        best, screening, before, before, further=False, strict=False
    )  # no pose that was left out gains by it
    assert nowhere.why == "no gain"
    assert not nowhere.leaves_doubt


def test_where_a_further_effect_is_refused_what_is_left_decides() -> None:
    clean, refused = left(0.05), Refusal("tool_sag", "nature")
    assert concluded(("backlash",), clean, refused=refused).verdict == "named"
    assert concluded((), clean, refused=refused).verdict == "unexplained"
    assert concluded((), clean, refused=refused).standing("tool_sag") == "refused"
    assert concluded((), clean, refused=Refusal("tool_sag", "no gain")).verdict == "adequate"


def twenty_four_poses(seed: int) -> Dataset:
    return simulate_dataset(
        "panda", rng=seed, effects=[("transmission_error", 4.0)],
        conditions=True, poses=24,
    ).dataset  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", sweep([1, 4], every_run=[4]))
def test_members_that_the_equations_do_not_bear_stay_out_and_the_dataset_is_diagnosed(seed: int) -> None:
    """All members of transmission error together take more equations than 19 training poses give."""
    assert diagnose(twenty_four_poses(seed)).verdict in ("named", "ambiguous", "unexplained")


@dataclass(frozen=True)
class Wave:
    """Twenty harmonics of one joint as one effect."""

    parameters = tuple(Parameter(f"a{k}", unit="rad", scale=1e-4) for k in range(1, 21))
    name = "wave"

    def apply(self, state: RobotState, **values: float) -> RobotState:
        waves = [value * np.sin((k + 1) * state.q_rad[:, 1]) for k, value in enumerate(values.values())]
        return state.add_joint_error(1, sum(waves, np.zeros(len(state.q_rad))))


def test_an_effect_wider_than_the_equations_bear_is_listed_with_what_would_help() -> None:
    dataset = twenty_four_poses(1)
    screening = screen(calibrate(dataset), families_from((Wave(),)))
    assert screening.candidates == ()
    (wave,) = screening.untestable
    assert wave.why.startswith("it has 20 parameters at least, and the fit leaves")
    assert wave.would_help.endswith("training poses or more")
