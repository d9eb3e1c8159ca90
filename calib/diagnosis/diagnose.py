"""Which physical effect is missing from the five-parameter model of a dataset.

Signs and order of joints, units, rows and the robot's table come first: where one of them is wrong, no effect is named.
The stepwise search names effects, each with its evidence, its doubt and its held-out gain. Then what the last fit
leaves over is tested, whatever was named: a cause outside the catalogue shows there. Moves may follow the verdict.
Where noise has another shape than was declared, or a few poses stand out from a fit that is otherwise clean, the search
is done once more with that shape or without those poses; where something is left that no effect explains, curves of the
joints are learned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.blas_threads import one_blas_thread
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.diagnosis.conclusion import concluded, with_learned, with_split
from calib.diagnosis.data_check import data_suspicions, diagnosis_of_problem, problem_beside_effects
from calib.diagnosis.decision_rules import (
    curves_say_more,
    is_convincing,
    noise_is_believed,
    predicts_worse,
)
from calib.diagnosis.effect_selection import FitStep, selected_curves
from calib.diagnosis.moves import Tell
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import MAX_EFFECTS, SearchSpace, first_fit, step_after
from calib.diagnosis.stepwise import search_stepwise
from calib.effects.catalogue import effects_named
from calib.effects.effect import Family
from calib.options import FitOptions
from calib.progress import OnStep, staged
from calib.screening.candidates import MIN_LEAD
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.noise.shown_noise import noise_of_repeats, noise_of_residual
from calib.screening.projected_residual import project_residual

MAX_SIGMAS_SHAPED = 2.0  # residual over noise, up to which its shape may explain it
MAX_OUTLIER_SHARE = 0.1  # share of poses that may stand out and still be called outliers


@dataclass(frozen=True)
class SearchAgain:
    """The search once more, without poses that stand out, leads to a clean verdict."""

    found: Diagnosis
    poses: tuple[str, ...]  # ids of those left out


@dataclass(frozen=True)
class AddCurves:
    """Curves of the joints predict poses that were left out better than the model without them."""

    found: Diagnosis
    curves: LearnedCurves


@dataclass(frozen=True)
class SearchWithNoise:
    """The search once more, with the points weighed by the shape of the noise, leads to a clean verdict."""

    found: Diagnosis


ClosingMove = SearchAgain | SearchWithNoise | AddCurves


@one_blas_thread()
def diagnose(
    dataset: Dataset,
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[str] = (),
    user_effects: Sequence[Family] = (),
    max_steps: int = MAX_EFFECTS,
    progress: bool = False,
    on_step: OnStep | None = None,
) -> Diagnosis:
    """Find what is missing from the five-parameter model.

    Args:
        dataset: with measured points; test poses are used to confirm only.
        options: what is asked of every fit.
        effects: families that are taken as present from the start, all joints.
        user_effects: families beyond the catalogue.
        max_steps: effects to add at the most.
        progress: show the stage under way, in a notebook's cell or at the terminal.
        on_step: called with a line of words before each stage.

    Raises:
        FitError, CalibError: too few poses, an unknown name.
    """
    space = SearchSpace.of(
        dataset,
        options,
        given=effects_named(dataset, effects, user_effects),
        user_effects=user_effects,
        max_effects=max_steps,
    )
    with staged(asked=progress, then=on_step) as tell:
        return whole_diagnosis(space, tell or (lambda words: None))


def whole_diagnosis(space: SearchSpace, tell: Tell) -> Diagnosis:
    """The search, its conclusion, and the moves that follow it."""
    repeated = noise_of_repeats(space.dataset)
    if repeated is not None:
        space = replace(space, options=replace(space.options, noise=repeated.shape))
    tell("fitting the geometry")
    first = first_fit(space)
    tell("holding joints, points and table against each other")
    doubts = data_suspicions(space, first)
    if doubts.problem is not None:
        return diagnosis_of_problem(space, first, doubts.problem)
    found = _searched(space, tell, first=first)
    problem = problem_beside_effects(space, found, doubts.open)
    if problem is not None:
        return diagnosis_of_problem(space, first, problem)
    while (move := closing_move(space, found, tell)) is not None:
        found = move.found
    return with_split(found)


def _searched(space: SearchSpace, tell: Tell, rival: str = "", first: FitStep | None = None) -> Diagnosis:
    """The verdict at the end of a search, which does not add the rival of a wander."""
    search = search_stepwise(space, tell, rival, first)
    tell("judging what is left")
    found = concluded(space, search.steps, search.stop)
    return replace(found, noise=replace(found.noise, rival=rival)) if found.noise is not None else found


def closing_move(space: SearchSpace, found: Diagnosis, tell: Tell) -> ClosingMove | None:
    """What may follow a verdict; None where it stands."""
    if found.learned is not None:
        return None
    space = replace(space, options=found.calibration.options)
    shaped = _with_noise_as_it_is(space, found, tell)
    if shaped is not None:
        return SearchWithNoise(shaped)
    left_out = found.calibration.outliers
    outliers = tuple(pose for pose in found.residual_tests.outlier_poses if pose not in left_out)
    again = not found.steps[-1].left_out and outliers
    if again and len(outliers) <= max(2, MAX_OUTLIER_SHARE * _measured_poses(found.calibration)):
        # Only now, with the effects in: a few wrong points bend the fit and hide or feign a pattern in all others.
        tell("once more without the poses that stand out")
        rest = _searched(space.without(outliers), tell, found.noise.rival if found.noise is not None else "")
        if rest.is_clean and set(found.named) <= set(rest.named):
            return SearchAgain(_of_all_poses(rest, outliers), outliers)
    return _curves_to_add(space.without(found.steps[-1].left_out), found, tell)


def _with_noise_as_it_is(space: SearchSpace, found: Diagnosis, tell: Tell) -> Diagnosis | None:
    """The search with the points weighed by the noise's shape; None where none shows, or it is not believed.

    Repeated measurements are believed whatever else is left.
    """
    taken, last = space.options.noise, found.calibration
    of_repeats = noise_of_repeats(space.dataset)
    told = taken is not None and (of_repeats is None or taken.wander is not None)
    if told or found.steps[-1].left_out or implausibility_reason(last):
        return None
    start, tests = found.steps[0].calibration, found.residual_tests
    if of_repeats is not None and taken is None:
        tell("once more with the noise of repeated measurements")
        return _searched(space.with_noise(of_repeats.shape, start), tell)
    unknown = tests.lack_of_fit_p is None or tests.residual_mm > MAX_SIGMAS_SHAPED * tests.noise_mm
    if found.verdict == "unexplained" and unknown:
        return None  # no shape of the declared size is that large
    beaten = next((one for one in found.added if one.effect == found.beaten), None)
    shown = noise_of_residual(last.fitted_dataset, beaten, project_residual(last), tests.outlier_poses)
    if shown is None:
        return None
    tell("once more with the noise as it is")
    again = _searched(space.with_noise(shown.shape, start), tell, shown.rival)
    return again if noise_is_believed(found, again) else None


def _measured_poses(calibration: Calibration) -> int:
    """How many poses have points; those of one stand count once."""
    points = calibration.fitted_dataset.points
    assert points is not None
    return len(np.unique(points.pose))


def _of_all_poses(rest: Diagnosis, outliers: tuple[str, ...]) -> Diagnosis:
    """The diagnosis without the outliers, told of all poses."""
    all_outliers = tuple(dict.fromkeys([*outliers, *rest.residual_tests.outlier_poses]))
    return replace(
        rest,
        verdict="ambiguous" if rest.open_sets else "outliers",
        residual_tests=replace(rest.residual_tests, outlier_poses=all_outliers),
        steps=tuple(replace(step, left_out=outliers) for step in rest.steps),
    )


def _curves_to_add(space: SearchSpace, found: Diagnosis, tell: Tell) -> AddCurves | None:
    """Where something is left that no effect explains: curves of the joints, if they predict poses left out better.

    They never take a name's place: not where the only one was refused or a further one is convincing, nor where effects
    are tied, unless the curves say more than twice as much; only a cause of one place or one pose gives way to curves
    that say more. A fault of one joint stays told unless all joints' curves say more.
    """
    last, fault = found.steps[-1], found.residual_tests.fault
    before = last.calibration
    only_refused = found.refused is not None and found.refused.leaves_doubt and not found.named
    if found.verdict not in ("unexplained", "ambiguous") or only_refused or implausibility_reason(before):
        return None
    unnamed = not found.left_to_curves and found.refused is None and not found.ambiguous_set
    if unnamed and any(map(is_convincing, found.screenings[-1].candidates)):
        return None  # as many effects as were asked for, and one more has a name
    tell("learning what the joints' curves explain")
    curves = last.curves
    if curves is None:
        return None
    if found.ambiguous_set:
        best = max((c.log_evidence for c in found.screenings[-1].candidates), default=0.0)
        if curves.log_evidence < MIN_LEAD + 2.0 * best:
            return None
        found = replace(found, verdict="unexplained", ambiguous_set=(), missing=(), suspected=found.named)
    selected = (*last.selected, selected_curves(curves))
    after = space.fit(selected, before)
    # A cause may be right and the test poses a little worse by chance; curves name none and have to earn their place.
    if predicts_worse(before, after, scatter=0.0) or before.after.train is None or after.after.train is None:
        return None
    if fault is not None and curves_say_more(curves, fault):
        found = replace(found, residual_tests=replace(found.residual_tests, fault=None))
    step = step_after(last, LEARNED, selected, after, lead=curves.log_evidence)
    return AddCurves(with_learned(found, step, curves.members), curves)
