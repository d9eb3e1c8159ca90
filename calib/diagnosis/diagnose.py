"""Which physical effect is missing from the five-parameter model of a dataset.

The stepwise search names effects, each with its evidence, its doubt and its held-out gain. Then what the last fit
leaves over is tested, whatever was named: a cause outside the catalogue shows there. Where a few poses stand out from a
fit that is otherwise clean, the search is done once more without them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from calib.blas_threads import one_blas_thread
from calib.calibration.calibrate import counted_by_stands
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.stands import without_poses
from calib.diagnosis.decision_rules import (
    carries_its_names,
    curves_say_more,
    is_convincing,
    predicts_worse,
    verdict_of,
)
from calib.diagnosis.effect_selection import FitStep, calibrate_with, curves_beside, selected_curves
from calib.diagnosis.findings import Learned
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.stepwise import Search, SearchSpace, Tell, search_stepwise
from calib.effects.catalogue import Family, effects_for, family_of
from calib.errors import FitError
from calib.options import FitOptions
from calib.screening.curves.effect_file import formula_text
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.pose_recommendation import DiscriminatingPose, discriminating_poses
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, run_residual_tests

MAX_OUTLIER_SHARE = 0.1  # share of poses that may stand out and still be called outliers


@one_blas_thread()
def diagnose(
    dataset: Dataset,
    options: FitOptions = FitOptions(),
    *,
    effects: Sequence[str] = (),
    user_effects: Sequence[Family] = (),
    max_steps: int = 3,
    on_step: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what is missing from the five-parameter model.

    Args:
        dataset: with measured points; test poses are used to confirm only.
        options: what is asked of every fit.
        effects: families that are taken as present from the start, all joints.
        user_effects: families beyond the catalogue.
        max_steps: effects to add at the most.
        on_step: called with a line of words before each stage.

    Raises:
        FitError, CalibError: too few poses, an unknown name.
    """
    tell = on_step or (lambda words: None)
    found = _diagnosis(_search_space(dataset, options, effects, user_effects), max_steps, tell)
    outliers = found.residual_tests.outlier_poses
    if 0 < len(outliers) <= max(2, MAX_OUTLIER_SHARE * _measured_poses(found.calibration)):
        # Only now, with the effects in: a few wrong points bend the fit and hide or feign a pattern in all others.
        tell("once more without the poses that stand out")
        others = _search_space(without_poses(dataset, outliers), options, effects, user_effects)
        found = _of_all_poses(found, _diagnosis(others, max_steps, tell), outliers)
    found = _with_learned_curves(found, tell)
    return replace(found, discriminating_poses=_discriminating_poses(found))


def _measured_poses(calibration: Calibration) -> int:
    """How many poses have points; those of one stand count once."""
    points = calibration.fitted_dataset.points
    assert points is not None
    return len(np.unique(points.pose))


def _search_space(
    dataset: Dataset, options: FitOptions, effects: Sequence[str], user_effects: Sequence[Family]
) -> SearchSpace:
    given = tuple(member for name in effects for member in family_of(dataset, name, user_effects).members)
    fitted = counted_by_stands(dataset, options.residual)
    return SearchSpace(dataset, options, given, (*effects_for(fitted), *user_effects))


def _diagnosis(space: SearchSpace, max_steps: int, tell: Tell) -> Diagnosis:
    """The search, and what its last fit leaves over."""
    search = search_stepwise(space, max_steps=max_steps, tell=tell)
    tell("judging what is left")
    residual_tests = run_residual_tests(space.dataset, project_residual(search.calibration))
    if search.ambiguous:  # then the residual holds the cause that was left open: a fault would be a guess
        residual_tests = replace(residual_tests, fault=None)
    added = tuple(candidate.name for candidate in search.chosen)
    only_refused = bool(search.refused) and not search.chosen
    doubted = only_refused or bool(search.leading_fault or search.implausible)
    verdict = verdict_of(added, search.ambiguous, doubted, residual_tests)
    claimed = carries_its_names(verdict, _tests_beside_open_set(space, search))
    return Diagnosis(
        verdict=verdict,
        missing=added if claimed else (),
        suspected=() if claimed else added,
        ambiguous_set=search.ambiguous,
        steps=search.steps,
        screenings=search.screenings,
        residual_tests=residual_tests,
        refused=search.refused,
        leading_fault=search.leading_fault,
    )


def _tests_beside_open_set(space: SearchSpace, search: Search) -> ResidualTests | None:
    """What is left with the best of the tied set in the model; None without one, or where nothing was added before."""
    best = next((c for c in search.screenings[-1].candidates if c.name in search.ambiguous), None)
    if best is None or not search.chosen:
        return None
    fit = space.fit((*search.chosen, best), search.calibration)
    return run_residual_tests(space.dataset, project_residual(fit))


def _of_all_poses(found: Diagnosis, rest: Diagnosis, outliers: tuple[str, ...]) -> Diagnosis:
    """The diagnosis without the outliers, where that is clean and loses no effect; else the first one."""
    clean = rest.verdict in ("adequate", "named", "outliers") and set(found.named) <= set(rest.missing)
    if not clean:
        return found
    all_outliers = tuple(dict.fromkeys([*outliers, *rest.residual_tests.outlier_poses]))
    return replace(
        rest,
        verdict="outliers",
        residual_tests=replace(rest.residual_tests, outlier_poses=all_outliers),
        steps=tuple(replace(step, left_out=outliers) for step in rest.steps),
    )


def _with_learned_curves(found: Diagnosis, tell: Tell) -> Diagnosis:
    """Where something is left that no effect explains: curves of the joints, if they predict poses left out better.

    They never take a name's place: not where effects are tied or the only one was refused, and not where a jump of
    one joint, which no curve holds, has more evidence. A fault of one joint stays told unless all joints' curves say
    more.
    """
    before, fault = found.calibration, found.leading_fault or found.residual_tests.fault
    only_refused = found.refused and not found.named
    if found.verdict != "unexplained" or only_refused or implausibility_reason(before):
        return found
    unnamed = found.leading_fault is None and not found.refused
    if unnamed and any(map(is_convincing, found.screenings[-1].candidates)):
        return found  # as many effects as were asked for, and one more has a name
    tell("learning what the joints' curves explain")
    curves = curves_beside(before, fault)
    if curves is None:
        return found
    last, learned = found.steps[-1], selected_curves(curves)
    given = before.model.added_effects[
        : len(before.model.added_effects) - sum(len(e.members) for e in last.selected)
    ]
    selected = (*last.selected, learned)
    after = calibrate_with(before.dataset, selected, before.options, effects=given, start=before)
    # A cause may be right and the test poses a little worse by chance; curves name none and have to earn their place.
    if predicts_worse(before, after, scatter=0.0) or before.after.train is None or after.after.train is None:
        return found
    values = dict(zip((p.name for p in after.fit.parameters), after.fit.x.tolist(), strict=True))
    if fault is not None and curves_say_more(curves, fault):
        found = replace(found, residual_tests=replace(found.residual_tests, fault=None), leading_fault=None)
    step = FitStep(f"+ {LEARNED}", selected, after, LEARNED, None, curves.log_evidence, last.left_out)
    return replace(
        found,
        steps=(*found.steps, step),
        screenings=(*found.screenings, found.screenings[-1]),
        learned=Learned(
            members=curves.members,
            formula=formula_text(curves.members, values),
            share=1.0 - (after.after.train.rmse_mm / before.after.train.rmse_mm) ** 2,
            before=before,
            after=after,
        ),
    )


def _discriminating_poses(found: Diagnosis) -> tuple[DiscriminatingPose, ...]:
    """Poses at which the effects of an ambiguous set differ most; () without one, and where none can be fitted."""
    tied = [c for c in found.screenings[-1].candidates if c.name in found.ambiguous_set]
    try:
        return discriminating_poses(found.calibration, tied)
    except FitError:  # too few poses to fit one of them
        return ()
