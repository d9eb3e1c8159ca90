"""The best poses of many: greedy one by one, then exchanged one against another until no exchange helps.

The exchange is Fedorov's (1972) with one pose given up at a time, as in DETMAX (Mitchell 1974).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.errors import CalibError
from calib.planning.question import Question

_SWEEPS = 30  # of exchanges, at the most
_GAIN = 1e-6  # of the log of the measure, below which an exchange is rounding
_SHARPNESS = 12.0  # of the smooth maximum over questions

ALL, WORST = "all", "worst"


@dataclass(frozen=True)
class Choice:
    """The chosen candidates."""

    rows: IndexArray  # (count,) into the candidates; the most telling first
    log_value: float  # of the questions together
    greedy_log_values: tuple[float, ...]  # (count,) with one more at a time, before any exchange
    exchanges: int


@one_blas_thread()
def best_poses(
    questions: Sequence[Question],
    count: int,
    *,
    together: str = ALL,
    exclude: BoolArray | None = None,
    start: IndexArray | None = None,
    exchange: bool = True,
) -> Choice:
    """Choose `count` candidates, each once, that answer the questions best.

    Args:
        questions: about the same candidates; each in its own unknowns.
        together: "all" makes the mean of the logs of their measures least, "worst" the largest of them.
        exclude: (N,) candidates that may not be chosen.
        start: candidates that are chosen already and stay.
        exchange: go on from the greedy choice.

    Raises:
        CalibError: fewer candidates than poses.
    """
    n = len(questions[0].rows)
    free = np.ones(n, dtype=bool) if exclude is None else ~exclude
    fixed = [] if start is None else [int(i) for i in start]
    free[fixed] = False
    if count > int(free.sum()):
        raise CalibError(f"found {int(free.sum())} candidates for {count} poses; ask for fewer poses")
    search = _Search(questions, together)
    informations = [question.known + _of(question, fixed) for question in questions]
    chosen: list[int] = []
    greedy: list[float] = []
    for _ in range(count):
        best, with_best = search.best(informations, free)
        greedy.append(with_best)
        search.change(informations, best, 1.0)
        chosen.append(best)
        free[best] = False
    value = search.value(informations)
    exchanges = 0
    for _ in range(_SWEEPS if exchange else 0):
        before = exchanges
        for k, given_up in enumerate(chosen):
            search.change(informations, given_up, -1.0)
            free[given_up] = True
            best, with_best = search.best(informations, free)
            if with_best > value - _GAIN:
                best = given_up
            else:
                value, exchanges = with_best, exchanges + 1
            search.change(informations, best, 1.0)
            free[best] = False
            chosen[k] = best
        if exchanges == before:
            break
        # Sums of many changes collect rounding.
        informations = [question.known + _of(question, fixed + chosen) for question in questions]
    rows = _by_worth(questions, together, fixed, chosen) if exchanges else np.array(chosen, dtype=np.int64)
    return Choice(rows, value, tuple(greedy), exchanges)


def _of(question: Question, chosen: Sequence[int]) -> Array:
    """(K, K) the information of some candidates."""
    rows = question.rows[list(chosen)].reshape(-1, question.rows.shape[2])
    return np.asarray(rows.T @ rows)


def _by_worth(questions: Sequence[Question], together: str, fixed: list[int], chosen: list[int]) -> IndexArray:
    """The chosen in the order in which a greedy search among them alone would take them."""
    informations = [question.known + _of(question, fixed) for question in questions]
    search = _Search([replace(question, rows=question.rows[chosen]) for question in questions], together)
    left = np.ones(len(chosen), dtype=bool)
    out = []
    for _ in chosen:
        best = search.best(informations, left)[0]
        search.change(informations, best, 1.0)
        left[best] = False
        out.append(chosen[best])
    return np.array(out, dtype=np.int64)


@dataclass(frozen=True)
class _Search:
    """The candidates' worth for several questions together."""

    questions: Sequence[Question]
    together: str

    def best(self, informations: Sequence[Array], free: BoolArray) -> tuple[int, float]:
        """The candidate that helps most, of those that are free, and the value with it."""
        each = [q.log_values_with(h) for q, h in zip(self.questions, informations, strict=True)]
        values = np.where(free, self._joined(np.array(each)), np.inf)
        best = int(np.argmin(values))
        return best, float(values[best])

    def value(self, informations: Sequence[Array]) -> float:
        each = [q.log_value(h) for q, h in zip(self.questions, informations, strict=True)]
        return float(self._joined(np.array(each)[:, None])[0])

    def change(self, informations: list[Array], candidate: int, sign: float) -> None:
        """Add a candidate's information, or take it away."""
        for k, question in enumerate(self.questions):
            rows = question.rows[candidate]
            informations[k] = informations[k] + sign * (rows.T @ rows)

    def _joined(self, logs: Array) -> Array:
        """(N,) of the logs of measures (Q, N)."""
        if self.together == ALL:
            return np.asarray(logs.mean(axis=0))
        # A smooth maximum, so that progress with the second worst counts while the worst stands still.
        top = logs.max(axis=0)
        return np.asarray(top + np.log(np.mean(np.exp(_SHARPNESS * (logs - top)), axis=0)) / _SHARPNESS)
