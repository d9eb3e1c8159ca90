"""Diagnosis of the physical effects that are missing from the five-parameter model of a dataset.

`next_move` decides what to do with a model: `diagnose` follows its moves to the end, the page offers them one by one.
Signs and order of joints, units, rows and the robot's table come first: where one of them is wrong, no effect is named.
Then effects are added and dropped, each with its evidence, its doubt and its gain at poses that no fit used. Then the
residual of the last fit is tested: a cause outside the catalogue shows there. Three moves may follow. Where the noise
has another shape than was declared, or a few poses stand out from a fit that is otherwise clean, the search is done
once more with that shape or without those poses; where a residual is left that no effect explains, curves of the joints
are learned.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

from calib.blas_threads import one_blas_thread
from calib.calibration.plausibility import implausibility_reason
from calib.calibration.result import Calibration
from calib.consistency.data_problem import DataProblem, FitVariant, Suspicions, problem_given_effects, suspicions
from calib.consistency.hypotheses import DataHypothesis
from calib.consistency.swapped_poses import swapped_poses
from calib.dataset.dataset import Dataset
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.learning import learned_to_add
from calib.diagnosis.model_diagnosis import diagnosis_of_model
from calib.diagnosis.moves import (
    AddCurves,
    AddEffect,
    DropEffect,
    LeaveOutPoses,
    Move,
    Search,
    SearchEnd,
    ShapeNoise,
    Tell,
    dropped_effects,
    fit_step_after,
    next_effect,
    search_stepwise,
)
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace, first_fit
from calib.progress import OnStep
from calib.screening.blunders import blunders_of
from calib.screening.curves.smooth_joint_error import LEARNED
from calib.screening.noise_search import noise_of_repeats, noise_of_residual
from calib.screening.projected_residual import project_residual
from calib.screening.residual_tests import ResidualTests, is_too_large

MAX_SIGMAS_SHAPED = 2.0  # residual over noise, up to which its shape may explain it


@one_blas_thread()
def whole_diagnosis(space: SearchSpace, on_step: OnStep | None = None) -> Diagnosis:
    """Diagnosis of a dataset, reached by following every recommended move from the fit of the link errors on."""
    tell = on_step or (lambda line: None)
    repeated = None if _has_lengths(space.dataset) else noise_of_repeats(space.dataset)
    if repeated is not None:
        space = replace(space, options=replace(space.options, noise=repeated.shape))
    tell("fitting the geometry")
    first = first_fit(space)
    tell("holding joints, points and table against each other")
    model = SearchState((first,), suspicions=data_suspicions(space, first))
    while not isinstance(move := next_move(space, model := model.ranked(space), tell), Diagnosis):
        model = model.after(move)
    return move


# ---- one move after the other ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SearchState:
    """A model in the course of a diagnosis, with the fit steps that led to it."""

    steps: tuple[FitStep, ...]  # that led to it
    dropped: frozenset[str] = frozenset()  # effects that are not to be added, as they were dropped before
    tests: ResidualTests | None = None  # of its residual, where they were done already
    suspicions: Suspicions | None = None  # on the data, where they were asked for already
    diagnosis: Diagnosis | None = None  # of it, where a move brought one

    def ranked(self, space: SearchSpace) -> SearchState:
        """The model with its last step screened, which all that follows then shares."""
        return replace(self, steps=(*self.steps[:-1], space.ranked(self.steps[-1])))

    def after(self, move: Move) -> SearchState:
        """The model that results from a move (adding or dropping an effect, say)."""
        match move:
            case AddEffect() | DropEffect():
                dropped = self.dropped.union(dropped_effects(move))
                return SearchState(
                    (*self.steps, fit_step_after(self.steps[-1], move)), dropped, suspicions=self.suspicions
                )
            case LeaveOutPoses() | ShapeNoise() | AddCurves():
                return SearchState(
                    move.diagnosis.steps, self.dropped, suspicions=self.suspicions, diagnosis=move.diagnosis
                )


def next_move(space: SearchSpace, model: SearchState, tell: Tell = lambda line: None) -> Move | Diagnosis:
    """The next move of the diagnosis from a model, or the final diagnosis where no move remains."""
    if model.diagnosis is not None:
        return _closing_move(space, model.diagnosis, tell) or model.diagnosis
    first, last = model.steps[0], model.steps[-1]
    of_fits = space.without(last.left_out)
    doubts = model.suspicions or (data_suspicions(of_fits, first) if not first.selected else Suspicions(None))
    if doubts.problem is not None:
        return _diagnosis_of_problem(of_fits, first, doubts.problem)
    steps = (*model.steps[:-1], of_fits.ranked(last))
    move = next_effect(of_fits, steps[-1], model.dropped, tell)
    if not isinstance(move, SearchEnd):
        return move
    tell("judging what is left")
    diagnosis = diagnosis_of_model(space, steps, move, model.tests)
    problem = _problem_given_effects(of_fits, diagnosis, doubts.open)
    if problem is not None:
        return _diagnosis_of_problem(of_fits, steps[0], problem)
    return _closing_move(space, diagnosis, tell) or diagnosis


# ---- data that are wrong --------------------------------------------------------------------------------------------


def data_suspicions(space: SearchSpace, first: FitStep) -> Suspicions:
    """Suspected mistakes in signs, order, units, rows or robot table, by a fit without selected effects."""

    def refit(dataset: Dataset, residual: str = space.options.residual) -> Calibration:
        return replace(space, dataset=dataset, options=space.options.with_residual(residual)).fit((), None)

    by_places = partial(refit, residual="position") if space.options.residual == "pose" else None
    return suspicions(first.calibration, refit, by_places=by_places)


def _diagnosis_of_problem(space: SearchSpace, first: FitStep, problem: DataProblem) -> Diagnosis:
    """Diagnosis of a dataset with a mistake in its data: the fit without effects, and no effect named."""
    return replace(diagnosis_of_model(space, [space.ranked(first)], SearchEnd()), data_problem=problem)


def _problem_given_effects(
    space: SearchSpace, diagnosis: Diagnosis, hypotheses: tuple[DataHypothesis, ...]
) -> DataProblem | None:
    """Mistake in the data that explains the residual with fewer effects than the search added; else None."""
    last = next(step for step in reversed(diagnosis.steps) if step.effect != LEARNED)
    if not hypotheses or diagnosis.verdict == "adequate":
        return None

    def variant(kept: Sequence[SelectedEffect], without: str = "") -> FitVariant:
        names = tuple(effect.name for effect in kept)
        return FitVariant(names, without, lambda dataset: replace(space, dataset=dataset).fit(kept, None))

    variants = [variant([e for e in last.selected if e is not one], one.name) for one in last.selected]
    variants.append(variant(last.selected))
    if diagnosis.refused is not None and diagnosis.refused.why == "nature":
        # An effect beyond nature was refused, so the search stopped early: each mended dataset gets its own search.
        for hypothesis in hypotheses:
            mended = replace(space, dataset=hypothesis.of_dataset(last.calibration.dataset))
            variants.append(variant(search_stepwise(mended, lambda line: None).steps[-1].selected))
    return problem_given_effects(last.calibration, hypotheses, variants)


# ---- moves after a search -------------------------------------------------------------------------------------------


def _closing_move(space: SearchSpace, diagnosis: Diagnosis, tell: Tell) -> Move | None:
    """Move after a search ended: reshape the noise, leave out outliers, or add curves; None if there is none."""
    if diagnosis.learned is not None:
        return None
    space = replace(space, options=diagnosis.calibration.options)
    last = diagnosis.steps[-1]
    shaped = _with_noise_as_shown(space, diagnosis, tell)
    if shaped is not None:
        return ShapeNoise(shaped)
    outliers = blunders_of(diagnosis.calibration, diagnosis.residual_tests)
    if outliers and not last.left_out:
        # Only now, with the effects in: a few wrong points bend the fit and hide or feign a pattern in all others.
        tell("once more without the poses that stand out")
        rival = diagnosis.noise.rival if diagnosis.noise is not None else ""
        rest = _clean_after_search(space.without(outliers), tell, rival, diagnosis.named)
        if rest is not None:
            return LeaveOutPoses(_of_all_poses(rest, outliers, space.dataset), outliers)
    return learned_to_add(space.without(last.left_out), diagnosis, tell)


def _searched(space: SearchSpace, tell: Tell, rival: str = "") -> Diagnosis:
    """Diagnosis at the end of a stepwise search that must not add the effect `rival`."""
    return _judged(space, search_stepwise(space, tell, rival), tell, rival)


def _judged(space: SearchSpace, search: Search, tell: Tell, rival: str) -> Diagnosis:
    """Diagnosis of the model at which a search ended."""
    tell("judging what is left")
    diagnosis = diagnosis_of_model(space, search.steps, search.stop)
    return diagnosis if diagnosis.noise is None else replace(diagnosis, noise=replace(diagnosis.noise, rival=rival))


def _clean_after_search(space: SearchSpace, tell: Tell, rival: str, named: Collection[str] = ()) -> Diagnosis | None:
    """Diagnosis at the end of a search, as `_searched` makes it; None where it is not clean or lacks an effect.

    named: effects that have to be in its model.
    """
    search = search_stepwise(space, tell, rival)
    last, stop = search.steps[-1], search.stop
    if not set(named) <= {effect.name for effect in last.selected} or stop.implausible or stop.left_to_curves:
        return None
    if is_too_large(last.calibration.dataset, project_residual(last.calibration)):
        return None  # known before the long tests of its patterns
    diagnosis = _judged(space, search, tell, rival)
    return diagnosis if diagnosis.is_clean else None


def _with_noise_as_shown(space: SearchSpace, diagnosis: Diagnosis, tell: Tell) -> Diagnosis | None:
    """Diagnosis under the noise shape estimated from the data; None if there is no shape, or it is not accepted.

    Repeated measurements are believed whatever else is left.
    """
    taken, last = space.options.noise, diagnosis.calibration
    if _has_lengths(space.dataset):  # a shape is of three coordinates
        return None
    of_repeats = noise_of_repeats(space.dataset)
    known = taken is not None and (of_repeats is None or taken.wander is not None)
    if known or diagnosis.steps[-1].left_out or implausibility_reason(last):
        return None
    start, tests = diagnosis.steps[0].calibration, diagnosis.residual_tests
    if of_repeats is not None and taken is None:
        tell("once more with the noise of repeated measurements")
        return _searched(space.with_noise(of_repeats.shape, start), tell)
    unknown = tests.lack_of_fit_p is None or tests.residual_mm > MAX_SIGMAS_SHAPED * tests.noise_mm
    if diagnosis.verdict == "unexplained" and unknown:
        return None  # no shape of the declared size is that large
    shown = noise_of_residual(
        last.fitted_dataset, diagnosis.no_more_than_drift, project_residual(last), tests.outlier_poses
    )
    if shown is None:
        return None
    tell("once more with the noise as it is")
    again = _clean_after_search(space.with_noise(shown.shape, start), tell, shown.rival)
    return again if again is not None and noise_is_believed(diagnosis, again) else None


def _has_lengths(dataset: Dataset) -> bool:
    return dataset.points is not None and dataset.points.lengths is not None


def noise_is_believed(before: Diagnosis, again: Diagnosis) -> bool:
    """Whether a search under the estimated noise shape leaves only noise and keeps every effect claimed before.

    An unknown cause may look like noise of a strange shape. As a shape keeps the declared size, its size gives it away:
    so a size has to be known where something was left without the shape.
    """
    if before.verdict == "unexplained" and again.residual_tests.lack_of_fit_p is None:
        return False
    return again.is_clean and set(before.missing) <= {*again.missing, *again.ambiguous_set}


def _of_all_poses(rest: Diagnosis, outliers: tuple[str, ...], dataset: Dataset) -> Diagnosis:
    """Diagnosis of a search without the outlying poses, with these poses recorded as outliers left out.

    `dataset` has the points of these poses, too.
    """
    all_outliers = tuple(dict.fromkeys([*outliers, *rest.all_tests.outlier_poses]))
    return replace(
        rest,
        all_tests=replace(rest.all_tests, outlier_poses=all_outliers),
        steps=tuple(replace(step, left_out=outliers) for step in rest.steps),
        swapped=swapped_poses(rest.calibration, dataset, outliers),
    )
