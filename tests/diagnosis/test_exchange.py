"""Effects that are exchanged: one that resembles the sum of two gives way to them; poses that test no step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from calib import calibrate
from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.diagnosis.decision_rules import predicts_worse
from calib.diagnosis.diagnose import SearchState, next_move
from calib.diagnosis.effect_selection import FitStep, candidate_of
from calib.diagnosis.model_diagnosis import diagnosis_of_model
from calib.diagnosis.moves import AddEffect, PartlyConfounded, SearchEnd, next_effect, search_stepwise
from calib.diagnosis.search_space import SearchSpace, first_fit, step_after, with_candidate
from calib.effects.base import Parameter
from calib.effects.catalogue.order_steps import ChangePoint, JointStep
from calib.effects.effect import Family, families_from
from calib.effects.state import RobotState
from calib.present.diagnosis import verdict as told
from calib.rendering.text import plain
from calib.simulation.simulate import simulate_dataset
from tests.support.changed import with_poses
from tests.support.hidden_dataset import with_joint_errors


def bump(q_rad: Array, middle_rad: float) -> Array:
    """A smooth bump over a joint's angle, one high."""
    return np.asarray(np.exp(-0.5 * ((q_rad - middle_rad) / 0.5) ** 2))


@dataclass(frozen=True)
class Bumps:
    """Errors of joints 2, 3 and 5 by a bump of each joint's angle, in fixed shares of one size."""

    name: str
    shares: tuple[float, float, float]
    middle_rad: float = 0.0
    parameters = (Parameter("size_rad", unit="rad", scale=3e-4),)

    def error_rad(self, q_rad: Array) -> Array:
        """Error (N, 3) of the three joints for a size of one."""
        return np.stack(
            [s * bump(q_rad[:, j], self.middle_rad) for s, j in zip(self.shares, (1, 2, 4), strict=True)], axis=1
        )

    def apply(self, state: RobotState, *, size_rad: float) -> RobotState:
        errors = size_rad * self.error_rad(state.q_rad)
        for column, joint in enumerate((1, 2, 4)):
            state = state.add_joint_error(joint, errors[:, column])
        return state


ONE = Bumps("one", (1.0, 0.0, 0.0))
TWO = Bumps("two", (0.0, 1.0, 0.0))
BLEND = Bumps("blend", (1.0, 1.0, 1.0))


def measured_with(*effects: tuple[Bumps, float]) -> Dataset:
    """Dataset of an arm of which some joints err by bumps."""
    dataset = simulate_dataset("rb5", rng=2, poses=80, noise_mm=0.05).dataset
    error_rad = np.zeros((len(dataset.poses), 3))
    for bumps, size_rad in effects:
        error_rad += size_rad * bumps.error_rad(dataset.poses.q)
    return with_joint_errors(dataset, dict(zip((1, 2, 4), error_rad.T, strict=True)))


@pytest.mark.slow
def test_an_effect_that_resembles_two_gives_way_where_two_are_all_that_may_be_added() -> None:
    dataset = measured_with((ONE, 1e-3), (TWO, 2e-3))
    families = families_from((ONE, TWO, BLEND))
    space = replace(SearchSpace.of(dataset, max_effects=2), families=families)
    model, moves = SearchState((first_fit(space),)), []
    while isinstance(move := next_move(space, model), AddEffect):
        moves.append((move.name, move.instead_of))
        said = plain(told.move(move))
        assert ("takes that effect's place" in said) == bool(move.instead_of)
        model = model.after(move)
    assert moves == [("blend", ""), ("two", ""), ("one", "blend")]
    assert "blend" in model.dropped
    assert move.named == ("two", "one")
    assert [step.effect for step in move.steps] == [None, "two", "one"]
    assert move.steps[-1].candidate is not None


@pytest.mark.slow
def test_an_effect_that_resembles_two_is_dropped_once_both_are_in_the_model() -> None:
    dataset = measured_with((ONE, 1e-3), (TWO, 2e-3))
    space = replace(SearchSpace.of(dataset), families=families_from((ONE, TWO, BLEND)))
    assert {effect.name for effect in search_stepwise(space, lambda line: None).steps[-1].selected} == {"one", "two"}


@pytest.mark.slow
def test_effects_of_one_place_are_found_together_where_curves_explain_more_than_either() -> None:
    families = tuple(replace(family, sparse=True) for family in families_from((ONE, TWO)))
    space = replace(SearchSpace.of(measured_with((ONE, 1.5e-3), (TWO, 2e-3))), families=families)
    selected = search_stepwise(space, lambda line: None).steps[-1].selected
    assert {effect.name for effect in selected} == {"one", "two"}


MIDDLES_RAD = (-0.6, -0.2, 0.2, 0.6)


@dataclass(frozen=True)
class Waves:
    """Error of one joint by four bumps of its angle: a family with a member for each of two joints."""

    joint: int
    name = "waves"
    parameters = tuple(Parameter(f"bump{k}_rad", unit="rad", scale=3e-4) for k in range(len(MIDDLES_RAD)))

    def apply(self, state: RobotState, **sizes_rad: float) -> RobotState:
        q_rad = state.q_rad[:, self.joint]
        error_rad = sum(size * bump(q_rad, at) for size, at in zip(sizes_rad.values(), MIDDLES_RAD, strict=True))
        return state.add_joint_error(self.joint, np.asarray(error_rad))


def step_of_waves(space: SearchSpace) -> FitStep:
    """Step that adds the waves to the links, whatever leads."""
    first = first_fit(space)
    candidate = candidate_of(space.screen(first.calibration), "waves")
    return step_after(first, "waves", *with_candidate(space, first, candidate), candidate)


def waves_and_a_bump(bump_rad: float) -> tuple[SearchSpace, FitStep]:
    """Search space of a dataset with waves of joint 2 and a single bump of joint 3, and the model that is found."""
    of_waves = ((replace(ONE, middle_rad=-0.2), 3e-3), (replace(ONE, middle_rad=0.2), -2e-3))
    dataset = measured_with(*of_waves, (TWO, bump_rad))
    families = (Family("waves", (Waves(1), Waves(2))), *families_from((TWO,)))
    space = replace(SearchSpace.of(dataset), families=families)
    return space, search_stepwise(space, lambda line: None).steps[-1]


@pytest.mark.slow
def test_a_part_on_one_joint_that_another_effect_explains_as_well_stays_where_the_effect_is_sure_elsewhere() -> None:
    """Waves of two joints explain waves of the one and the other's single bump, all at once and so best."""
    space, last = waves_and_a_bump(2e-3)
    assert [effect.name for effect in last.selected] == ["waves"]
    stop = next_effect(space, last)
    assert isinstance(stop, SearchEnd)
    assert stop.ties == ()


@pytest.mark.slow
def test_an_effect_of_one_joint_is_left_open_beside_one_of_another_law_that_comes_near() -> None:
    waves = (replace(ONE, middle_rad=-0.2), 2e-3)
    families = (
        Family("waves", (Waves(1),)),
        Family("law", (ONE, TWO), sparse=True, most_members=1, finer=lambda one: ()),
    )
    space = replace(SearchSpace.of(measured_with(waves)), families=families)
    near = replace(families[1], members=(replace(ONE, name="law", middle_rad=-0.21),))
    space = replace(space, families=(families[0], near))
    last = space.ranked(step_of_waves(space))
    stop = next_effect(space, last)
    assert isinstance(stop, SearchEnd)
    assert stop.ties == (PartlyConfounded("waves", ("law",)),)
    found = diagnosis_of_model(space, [space.ranked(first_fit(space)), last], stop)
    assert [one.names for one in found.confounded_sets] == [("waves", "law")]
    assert (found.ambiguous_set, found.missing) == (("waves", "law"), ())


@pytest.mark.slow
def test_a_part_on_one_joint_goes_to_an_effect_that_explains_it_better(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calib.diagnosis.moves.MIN_OVER_SELECTED", 1.0)
    _, last = waves_and_a_bump(2e-3)
    waves, two = last.selected
    assert (waves.name, waves.members, two.members) == ("waves", (Waves(1),), (TWO,))


def test_poses_inside_the_gap_of_a_step_test_nothing() -> None:
    """Whether a test pose between the last pose before a step and the first after it is moved, no fit can know."""
    dataset = measured_with()
    order = np.arange(len(dataset.poses))
    in_gap = (order >= 30) & (order < 36)
    tested = (in_gap | (order % 10 == 5)) & (dataset.poses.role != "reference")
    role = np.where(tested, "test", np.where(dataset.poses.role == "test", "train", dataset.poses.role))
    dataset = with_poses(dataset, role=role)
    before = calibrate(dataset)
    step = JointStep(1, ChangePoint(30, dataset.poses.ids[36]))
    after = calibrate(dataset, effects=[step])
    as_before = before.after.error_mm
    in_the_gap = as_before + np.where(in_gap[before.after.pose], 5.0, 0.0)[:, None]
    assert not predicts_worse(before, replace(after, after=replace(after.after, error_mm=in_the_gap)))
    assert predicts_worse(before, replace(after, after=replace(after.after, error_mm=as_before + 5.0)))
