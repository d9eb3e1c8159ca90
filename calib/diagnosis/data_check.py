"""Data that are wrong, before and beside effects: a diagnosis that names none where the sheet or the table is at fault."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from calib.calibration.result import Calibration
from calib.consistency.data_problem import DataProblem, Suspicions, suspicions, weighed
from calib.consistency.hypotheses import Hypothesis
from calib.dataset.dataset import Dataset
from calib.diagnosis.conclusion import concluded
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.moves import Stop
from calib.diagnosis.result import Diagnosis
from calib.diagnosis.search_space import SearchSpace
from calib.errors import CalibError
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
    space: SearchSpace, found: Diagnosis, open_hypotheses: tuple[Hypothesis, ...]
) -> DataProblem | None:
    """What is wrong with the data after all, where that explains what effects were found for, with fewer of them."""
    steps = [step for step in found.steps if step.effect != LEARNED]
    last = steps[-1]
    if not last.selected or not open_hypotheses:
        return None

    def without_one(dataset: Dataset) -> Iterator[Calibration]:
        elsewhere = replace(space, dataset=dataset)
        for effect in last.selected:
            try:
                yield elsewhere.fit([other for other in last.selected if other is not effect], None)
            except CalibError:  # the effect was what held the fit together
                continue

    def with_all(dataset: Dataset) -> Calibration:
        return replace(space, dataset=dataset).fit(last.selected, None)

    return weighed(last.calibration, open_hypotheses, without_one, with_all)
