"""What a search that has ended concludes: the verdict, what is claimed, and what is only suspected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib.calibration.held_out import held_out_test
from calib.calibration.result import Calibration
from calib.diagnosis.decision_rules import (
    carries_its_names,
    verdict_of,
)
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.findings import Learned
from calib.diagnosis.moves import Stop, next_move
from calib.diagnosis.open_sets import doubts_of, open_sets
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, step_after
from calib.diagnosis.stepwise import way_to
from calib.errors import FitError
from calib.screening.curves.effect_file import formula_text
from calib.screening.curves.smooth_joint_error import LEARNED, SmoothJointError
from calib.screening.noise.from_repeats import scatter_of_repeats
from calib.screening.noise.shown_noise import ShownNoise, first_beaten
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, run_residual_tests
from calib.screening.rivals.further_poses import further_poses
from calib.screening.rivals.split import split

NEXT_POSES = 5  # that are advised where a set is open


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
    only_refused = stop.refused is not None and stop.refused.leaves_doubt and not added
    doubted = only_refused or stop.left_to_curves or stop.implausible
    way = way_to(space, steps)
    opened = open_sets(space, way)
    promise = held_out_test(last.calibration, tests.noise_mm, tests.noise_from)
    broken = promise is not None and promise.is_broken
    verdict = verdict_of(added, ambiguous, doubted, tests, stays_open=bool(opened), promise_broken=broken)
    claimed = carries_its_names(verdict, _tests_beside_open_set(space, last, stop))
    names = tuple(dict.fromkeys(name for found in opened for name in found.names))
    found = Diagnosis(
        verdict=verdict,
        missing=tuple(name for name in added if name not in names) if claimed else (),
        suspected=() if claimed else added,
        ambiguous_set=tuple(dict.fromkeys([*names, *ambiguous])),
        open_sets=opened,
        steps=way,
        residual_tests=tests,
        refused=stop.refused,
        held_out=promise,
        left_to_curves=stop.left_to_curves,
        noise=_noise_taken(last.calibration),
    )
    return found if stop.implausible else _held_against_a_wander(found)


def _held_against_a_wander(found: Diagnosis) -> Diagnosis:
    """No claim where a slow wander of the instrument says as much as an effect that was added."""
    noise = found.calibration.options.noise
    if noise is not None and noise.wander is not None:
        return found  # it is in the noise already
    beaten = first_beaten(found.added, found.residual_tests.outlier_poses)
    if beaten is None:
        return found
    verdict = "ambiguous" if found.ambiguous_set else "unexplained"
    return replace(found, verdict=verdict, missing=(), suspected=found.named, beaten=beaten.effect)


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


def with_learned(found: Diagnosis, step: FitStep, members: Sequence[SmoothJointError]) -> Diagnosis:
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
    alone = next((step for step in reversed(steps) if _same(step, names, last)), None)
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
    return with_learned(found, step, [m for m in curves.members if isinstance(m, SmoothJointError)])


def _same(step: FitStep, selected: Sequence[object], last: FitStep) -> bool:
    """Whether a step has these effects, fitted to the poses of the last one."""
    without = step.calibration.dataset.left_out == last.calibration.dataset.left_out
    return step.selected == tuple(selected) and step.left_out == last.left_out and without


def with_split(found: Diagnosis) -> Diagnosis:
    """With the next poses by which the first set that is open is told apart; none where none can be."""
    doubts = doubts_of(found)
    if not doubts or len(doubts[0].rivals) < 2:
        return found
    doubt = doubts[0]
    try:
        split_by = split(doubt.calibration, doubt.rivals, further_poses(doubt.calibration), NEXT_POSES)
    except FitError:  # too few poses to tell a rival at all
        return found
    return replace(found, split=split_by)
