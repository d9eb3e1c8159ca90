"""Selection of the best poses among many candidates: greedy one by one, then exchanged until none improves.

The exchange is Fedorov's (1972) with one pose given up at a time, as in DETMAX (Mitchell 1974).

Optimality is linear algebra. A candidate's rows are the derivative of its measured numbers by the unknowns, in units of
their noise. The information (inverse covariance) with some poses measured is H = prior information + sum of rows^T rows
over these poses. A question prefers poses with a small measure of the covariance C = H^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.errors import CalibError


@dataclass(frozen=True)
class OptimalityCriterion:
    """Optimality question: target combinations of K unknowns, prior information, and rows of N candidate poses.

    With W the target combinations the measure is trace(W^T C W), the sum of their variances: I-optimal where W are the
    rows of a region's points, A-optimal for single coefficients.
    """

    rows: Array  # (N, r, K)
    prior_information: Array  # (K, K), positive definite
    target_combinations: Array  # (K, m)

    def __post_init__(self) -> None:
        n = self.prior_information.shape[0]
        shapes = self.prior_information.shape, self.rows.shape[2], self.target_combinations.shape[0]
        assert shapes == ((n, n), n, n)

    def log_value(self, information: Array) -> float:
        """Log of the question's measure for an information matrix (K, K)."""
        covariance = inverse(information)
        target_covariance = self.target_combinations.T @ covariance @ self.target_combinations
        return float(np.log(np.trace(target_covariance)))

    def log_values_with(self, information: Array) -> Array:
        """Log of the question's measure (N,) with each one of N candidates added to an information matrix.

        By Woodbury: C' = C - C R^T (1 + R C R^T)^-1 R C, an r x r system for each candidate.
        """
        covariance = inverse(information)
        n, r, k = self.rows.shape
        flat = self.rows.reshape(n * r, k)
        spread = np.matmul((flat @ covariance).reshape(n, r, k), np.swapaxes(self.rows, 1, 2))
        spread = spread + np.eye(r)
        cross_covariance = covariance @ self.target_combinations  # (K, m)
        target_covariance = self.target_combinations.T @ cross_covariance
        squares = _squares(flat, cross_covariance, self.rows)
        drop = np.trace(np.linalg.solve(spread, squares), axis1=1, axis2=2)
        least = 1e-12 * np.trace(target_covariance)  # rounding
        return np.log(np.maximum(np.trace(target_covariance) - drop, least))


def condensed(combinations: Array) -> Array:
    """At most K combinations that have the same total variance as the given combinations (K, m)."""
    k, m = combinations.shape
    return combinations if m <= k else np.asarray(np.linalg.qr(combinations.T, mode="r")).T


def inverse(information: Array) -> Array:
    """Covariance (K, K) from an information matrix (K, K). Raises CalibError where that is not positive definite."""
    # In units in which the diagonal is 1: unknown frames and known lengths are many powers of ten apart.
    size = np.sqrt(np.diag(information))
    try:
        root = np.linalg.inv(np.linalg.cholesky(information / np.outer(size, size)))
    except np.linalg.LinAlgError:
        raise CalibError(
            "what is known before planning bounds no unknown in some direction; plan with the prior"
        ) from None
    return (root.T @ root) / np.outer(size, size)


def _squares(flat: Array, factor: Array, rows: Array) -> Array:
    """Products R B B^T R^T (N, r, r) of each candidate's rows R (r, K) and a factor B (K, m).

    `flat` has all rows (N r, K).
    """
    n, r, k = rows.shape
    if factor.shape[1] < k:
        products = (flat @ factor).reshape(n, r, -1)
        return products @ np.swapaxes(products, 1, 2)
    return (flat @ (factor @ factor.T)).reshape(n, r, k) @ np.swapaxes(rows, 1, 2)


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
