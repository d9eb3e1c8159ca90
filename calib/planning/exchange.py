"""Selection of the best poses among many candidates: greedy one by one, then exchanged until none improves.

The exchange is Fedorov's (1972) with one pose given up at a time, as in DETMAX (Mitchell 1974).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.errors import CalibError
from calib.planning.question import OptimalityCriterion

_SWEEPS = 30  # most sweeps of exchanges over all chosen poses
_GAIN = 1e-6  # change of the log of the measure below which an exchange is rounding


@dataclass(frozen=True)
class Choice:
    """Candidate poses chosen for one or more optimality questions, with the mean log measure that they reach."""

    rows: IndexArray  # (count,) indices of candidates, the most informative first
    log_value: float  # mean over the questions of the log of their measures
    greedy_log_values: tuple[float, ...]  # (count,) `log_value` with the first 1, 2, ... poses, before any exchange


@one_blas_thread()
def best_poses(
    questions: Sequence[OptimalityCriterion], count: int, *, exclude: BoolArray | None = None, exchange: bool = True
) -> Choice:
    """Choice of `count` different candidates with the least mean log measure over the questions.

    Args:
        questions: questions about the same candidates, each with its own unknowns.
        count: number of candidates to choose.
        exclude: (N,) candidates that may not be chosen.
        exchange: whether to improve the greedy choice by exchanges.

    Raises:
        CalibError: fewer candidates than poses.
    """
    free = np.ones(len(questions[0].rows), dtype=bool) if exclude is None else ~exclude
    if count > int(free.sum()):
        raise CalibError(f"found {int(free.sum())} candidates for {count} poses; ask for fewer poses")
    search = _Search(questions)
    informations = [question.prior_information for question in questions]
    chosen: list[int] = []
    greedy: list[float] = []
    for _ in range(count):
        best, with_best = search.best(informations, free)
        greedy.append(with_best)
        search.add(informations, best, 1.0)
        chosen.append(best)
        free[best] = False
    value = search.value(informations)
    exchanged = False
    for _ in range(_SWEEPS if exchange else 0):
        before = value
        for k, given_up in enumerate(chosen):
            search.add(informations, given_up, -1.0)
            free[given_up] = True
            best, with_best = search.best(informations, free)
            if with_best > value - _GAIN:
                best = given_up
            else:
                value, exchanged = with_best, True
            search.add(informations, best, 1.0)
            free[best] = False
            chosen[k] = best
        if value == before:
            break
        # Sums of many changes collect rounding.
        informations = [_information(question, chosen) for question in questions]
    rows = _ranked(questions, chosen) if exchanged else np.array(chosen, dtype=np.int64)
    return Choice(rows, value, tuple(greedy))


def _information(question: OptimalityCriterion, chosen: Sequence[int]) -> Array:
    """Information matrix (K, K) of a question's unknowns after some candidates are measured."""
    rows = question.rows[list(chosen)].reshape(-1, question.rows.shape[2])
    return question.prior_information + rows.T @ rows


def _ranked(questions: Sequence[OptimalityCriterion], chosen: list[int]) -> IndexArray:
    """Chosen candidates, most informative first, as a greedy search among them would take them."""
    informations = [question.prior_information for question in questions]
    search = _Search([replace(question, rows=question.rows[chosen]) for question in questions])
    free = np.ones(len(chosen), dtype=bool)
    ranked = []
    for _ in chosen:
        best = search.best(informations, free)[0]
        search.add(informations, best, 1.0)
        free[best] = False
        ranked.append(chosen[best])
    return np.array(ranked, dtype=np.int64)


@dataclass(frozen=True)
class _Search:
    """Search for the candidate with the least mean log measure over several questions."""

    questions: Sequence[OptimalityCriterion]

    def best(self, informations: Sequence[Array], free: BoolArray) -> tuple[int, float]:
        """Index of the best of the free candidates, and the mean log measure with it."""
        each = [q.log_values_with(h) for q, h in zip(self.questions, informations, strict=True)]
        values = np.where(free, np.mean(each, axis=0), np.inf)
        best = int(np.argmin(values))
        return best, float(values[best])

    def value(self, informations: Sequence[Array]) -> float:
        """Mean over the questions of the log of their measures, each for its own information matrix."""
        return float(np.mean([q.log_value(h) for q, h in zip(self.questions, informations, strict=True)]))

    def add(self, informations: list[Array], candidate: int, sign: float) -> None:
        """Add a candidate's information to each question's information matrix, or subtract it where `sign` is -1."""
        for k, question in enumerate(self.questions):
            rows = question.rows[candidate]
            informations[k] = informations[k] + sign * (rows.T @ rows)
