"""Data that are wrong, before and beside effects: where the sheet or the table is at fault, no effect is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calib.consistency.data_problem import DataProblem, EffectModel, Suspicions, suspicions, weighed
from calib.consistency.hypotheses import DataHypothesis
from calib.diagnosis.conclusion import concluded
from calib.diagnosis.effect_selection import FitStep, SelectedEffect
from calib.diagnosis.moves import Stop
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.diagnosis.stepwise import search_stepwise
from calib.screening.curves.smooth_joint_error import LEARNED


def data_suspicions(space: SearchSpace, first: FitStep) -> Suspicions:
    """What a fit without selected effects says of signs, order, units, rows and table."""
    return suspicions(first.calibration, lambda dataset: replace(space, dataset=dataset).fit((), None))


def diagnosis_of_problem(space: SearchSpace, first: FitStep, problem: DataProblem) -> Diagnosis:
    """The diagnosis of data that are wrong: of the fit without effects, with nothing named or suspected."""
    found = concluded(space, [space.ranked(first)], Stop(implausible=True))
    tests = replace(found.residual_tests, fault=None)
    return replace(found, verdict="unexplained", residual_tests=tests, data_problem=problem)


def problem_beside_effects(
    space: SearchSpace, found: Diagnosis, open_hypotheses: tuple[DataHypothesis, ...]
) -> DataProblem | None:
    """What is wrong with the data after all, where that explains what effects were found for, with fewer of them."""
    steps = [step for step in found.steps if step.effect != LEARNED]
    last = steps[-1]
    if not open_hypotheses or found.verdict == "adequate":
        return None

    def model(without: SelectedEffect | None) -> EffectModel:
        return _beside(space, [effect for effect in last.selected if effect is not without], without)

    models = [*map(model, last.selected), model(None)]
    if found.refused is not None and found.refused.why == "nature":
        # What would explain the data is larger than nature has it, so the search stopped early: each mend gets its own.
        for hypothesis in open_hypotheses:
            mended = replace(space, dataset=hypothesis.of_dataset(last.calibration.dataset))
            models.append(_beside(space, search_stepwise(mended, lambda words: None).steps[-1].selected))
    return weighed(last.calibration, open_hypotheses, models)


def _beside(space: SearchSpace, kept: Sequence[SelectedEffect], without: SelectedEffect | None = None) -> EffectModel:
    return EffectModel(
        tuple(effect.name for effect in kept),
        "" if without is None else without.name,
        lambda dataset: replace(space, dataset=dataset).fit(kept, None),
    )
