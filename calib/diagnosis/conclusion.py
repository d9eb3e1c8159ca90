"""What a search that has ended concludes, and the two moves that may still follow its verdict.

Where a few poses stand out from a fit that is otherwise clean, the search is done once more without them; where
something is left that no effect explains, curves of the joints are learned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import (
    MIN_LEAD,
    carries_its_names,
    curves_say_more,
    is_convincing,
    noise_is_believed,
    predicts_worse,
    verdict_of,
)
from calib.diagnosis.effect_selection import FitStep, SelectedEffect, selected_curves
from calib.diagnosis.findings import Learned
from calib.diagnosis.moves import Stop, Tell, next_move
from calib.diagnosis.open_sets import open_sets
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, step_after
from calib.diagnosis.stepwise import search_stepwise, way_to
from calib.errors import FitError
from calib.screening.curves.effect_file import formula_text
from calib.screening.curves.joint_curves import LearnedCurves
from calib.screening.curves.smooth_joint_error import LEARNED, SmoothJointError
from calib.screening.noise.from_repeats import scatter_of_repeats
from calib.screening.noise.shown_noise import ShownNoise, noise_of_repeats, noise_of_residual
from calib.screening.pose_recommendation import DiscriminatingPose, discriminating_poses
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, run_residual_tests

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


def whole_diagnosis(space: SearchSpace, tell: Tell) -> Diagnosis:
    """The search, its conclusion, and the moves that follow it."""
    repeated = noise_of_repeats(space.dataset)
    if repeated is not None:
        space = replace(space, options=replace(space.options, noise=repeated.shape))
    found = _searched(space, tell)
    while (move := closing_move(space, found, tell)) is not None:
        found = move.found
    return with_discriminating_poses(found)


def _searched(space: SearchSpace, tell: Tell, rival: str = "") -> Diagnosis:
    """The verdict at the end of a search, which does not add the rival of a wander."""
    search = search_stepwise(space, tell, rival)
    tell("judging what is left")
    found = concluded(space, search.steps, search.stop)
    return replace(found, noise=replace(found.noise, rival=rival)) if found.noise is not None else found


def concluded(
    space: SearchSpace, steps: Sequence[FitStep], stop: Stop, tests: ResidualTests | None = None
) -> Diagnosis:
    """The verdict on a model from which no move leads on, and what its fit leaves over.

    Args:
        space: of the fits.
        steps: that led to the model, by whatever way; told is the straight one.
        stop: why there is no further move.
        tests: of the last fit, where they were done already.
    """
    last = steps[-1]
    space = space.without(last.left_out)
    if any(effect.name == LEARNED for effect in last.selected):
        return _with_curves_inside(space, steps)
    if tests is None:
        tests = run_residual_tests(last.calibration.dataset, project_residual(last.calibration))
    left_out = last.calibration.outliers  # by robust fits
    if left_out:
        tests = replace(tests, outlier_poses=tuple(dict.fromkeys([*left_out, *tests.outlier_poses])))
    if stop.ambiguous:  # then the residual holds the cause that was left open: a fault would be a guess
        tests = replace(tests, fault=None)
    added = tuple(effect.name for effect in last.selected)
    ambiguous = tuple(candidate.name for candidate in stop.ambiguous)
    only_refused = bool(stop.refused) and not added
    doubted = only_refused or stop.left_to_curves or stop.implausible
    way = way_to(space, steps)
    opened = open_sets(space, way)
    verdict = verdict_of(added, ambiguous, doubted, tests, stays_open=bool(opened))
    claimed = carries_its_names(verdict, _tests_beside_open_set(space, last, stop))
    names = tuple(dict.fromkeys(name for found in opened for name in found.names))
    return Diagnosis(
        verdict=verdict,
        missing=tuple(name for name in added if name not in names) if claimed else (),
        suspected=() if claimed else added,
        ambiguous_set=tuple(dict.fromkeys([*names, *ambiguous])),
        open_sets=opened,
        steps=way,
        residual_tests=tests,
        refused=stop.refused,
        left_to_curves=stop.left_to_curves,
        noise=_noise_taken(last.calibration),
    )


def _noise_taken(calibration: Calibration) -> ShownNoise | None:
    """The shape of the noise that a fit took."""
    shape = calibration.options.noise
    if shape is None:
        return None
    return ShownNoise(shape, from_repeats=scatter_of_repeats(calibration.dataset) is not None)


def _tests_beside_open_set(space: SearchSpace, last: FitStep, stop: Stop) -> ResidualTests | None:
    """What is left with the best of the tied set in the model; None without one, or where nothing was added before."""
    if not stop.ambiguous or not last.selected:
        return None
    fit = space.fit((*last.selected, SelectedEffect.of(stop.ambiguous[0])), last.calibration)
    return run_residual_tests(fit.dataset, project_residual(fit))


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
        clean = rest.verdict in ("adequate", "named", "outliers") or (rest.open_sets and not rest.suspected)
        if clean and not rest.tied and set(found.named) <= set(rest.named):
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
    tell("once more with the noise as it is")
    start = found.steps[0].calibration
    if of_repeats is not None and taken is None:
        return _searched(space.with_noise(of_repeats.shape, start), tell)
    outliers = found.residual_tests.outlier_poses
    shown = noise_of_residual(last.fitted_dataset, found.added, project_residual(last), outliers)
    if shown is None:
        return None
    again = _searched(space.with_noise(shown.shape, start), tell, shown.rival)
    return again if noise_is_believed(found, again, shown.rival) else None


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
    only_refused = found.refused and not found.named
    if found.verdict not in ("unexplained", "ambiguous") or only_refused or implausibility_reason(before):
        return None
    unnamed = not found.left_to_curves and not found.refused and not found.ambiguous_set
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
    return AddCurves(_with_learned(found, step, curves.members), curves)


def _with_learned(found: Diagnosis, step: FitStep, members: Sequence[SmoothJointError]) -> Diagnosis:
    """A diagnosis with the step that added curves."""
    before, after = found.calibration, step.calibration
    assert before.after.train is not None
    assert after.after.train is not None
    values = dict(zip((p.name for p in after.fit.parameters), after.fit.x.tolist(), strict=True))
    learned = Learned(
        members=tuple(members),
        formula=formula_text(tuple(members), values),
        share=1.0 - (after.after.train.rmse_mm / before.after.train.rmse_mm) ** 2,
        before=before,
        after=after,
    )
    # What is not in the model is judged by what the named effects left over, before the curves took it away.
    step = replace(step, screening=found.steps[-1].screening)
    return replace(found, steps=(*found.steps, step), learned=learned)


def _with_curves_inside(space: SearchSpace, steps: Sequence[FitStep]) -> Diagnosis:
    """The conclusion on a model with curves: that on the model without them, and the step that adds them."""
    last = steps[-1]
    names = tuple(effect for effect in last.selected if effect.name != LEARNED)
    curves = next(effect for effect in last.selected if effect.name == LEARNED)
    alone = next((step for step in reversed(steps) if _same(step, names, last.left_out)), None)
    if alone is None:
        alone = FitStep("", names, space.fit(names, None), left_out=last.left_out)
    others = [step for step in steps if step is not last and step is not alone]
    alone = space.ranked(alone)
    move = next_move(space, alone)
    found = concluded(space, [*others, alone], move if isinstance(move, Stop) else Stop())
    # What no name explains is held by the curves, so no name is claimed.
    found = replace(found, verdict="unexplained", ambiguous_set=(), missing=(), suspected=found.named)
    step = step_after(
        found.steps[-1], LEARNED, (*found.steps[-1].selected, curves), last.calibration,
        lead=last.log_evidence_margin,
    )  # fmt: skip
    return _with_learned(found, step, [m for m in curves.members if isinstance(m, SmoothJointError)])


def _same(step: FitStep, selected: Sequence[object], left_out: Sequence[str]) -> bool:
    return step.selected == tuple(selected) and step.left_out == tuple(left_out)


def with_discriminating_poses(found: Diagnosis) -> Diagnosis:
    """With the poses at which the effects of an ambiguous set differ most; none where none can be fitted."""
    return replace(found, discriminating_poses=_discriminating_poses(found))


def _discriminating_poses(found: Diagnosis) -> tuple[DiscriminatingPose, ...]:
    tied = [c for c in found.screenings[-1].candidates if c.name in found.tied]
    try:
        return discriminating_poses(found.calibration, tied)
    except FitError:  # too few poses to fit one of them
        return ()
