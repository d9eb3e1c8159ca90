"""A calibration as it is told, and the documents of the figures that others are told with."""

from __future__ import annotations

from typing import Any

from calib.calibration.evaluation import Evaluation
from calib.consistency.data_problem import DataProblem
from calib.present.results import document


@document.register
def _evaluation_document(evaluation: Evaluation) -> dict[str, Any]:
    return {"train": evaluation.train, "test": evaluation.test}


@document.register
def _data_problem_document(problem: DataProblem) -> dict[str, Any]:
    return {
        "kind": problem.kind,
        "joints": problem.joints,
        "mend": problem.remedy,
        "rmse_mm": {"now": problem.now_mm, "then": problem.then_mm},
        "words": problem.words,
    }
