"""How well a block of columns explains a residual: F tests, and the evidence of a cause whose size is unknown.

Everything here is linear and works on what is left of residual and columns after the fitted directions are projected
out. The noise's sigma is never needed: it is estimated with each hypothesis, so a wrongly declared one changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

Array = NDArray[np.float64]

_SIZES = np.geomspace(
    1e-3, 1e4, 57
)  # of a member's coefficients, in units that make its columns one sigma each
_GAIN = 0.5  # a further member has to raise the log evidence by this, beyond what choosing it costs


@dataclass(frozen=True)
class Problem:
    """A residual and a family's columns, projected: r (R,), a group of columns (R, K_g) a member, degrees of freedom.

    Columns are those of a coefficient of the parameter's usual size.
    """

    residual: Array
    groups: tuple[Array, ...]
    freedom: int


@dataclass(frozen=True)
class Evidence:
    """What a family is worth. `log_evidence` is against noise alone, sizes chosen to be most favourable."""

    p_value: float  # F test of the whole family or of its best member, whichever is smaller, paid for
    log_evidence: float
    sizes: Array  # (G,) of each member's coefficients; zero where it is not needed
    coefficients: tuple[Array, ...]  # posterior means, one array a member
    explained: Array  # (R,) the part of the residual that they make
    rank: int


def weigh(problem: Problem) -> Evidence:
    """F test and evidence of a family.

    Evidence: coefficients of member g are N(0, s_g^2), noise N(0, sigma^2) with sigma unknown,

        log E(s) = -1/2 log det(1 + B S^2 B^T) - nu/2 log(r^T (1 + B S^2 B^T)^-1 r / r^T r),

    maximised over one s for all members, and over separate ones where few members carry the effect; each member that is
    chosen then costs log(number of members), as it could have been any.
    """
    y, rest, triangle, bounds = _reduce(problem.residual, problem.groups)
    total = rest + float(y @ y)
    if triangle.shape[1] == 0 or total <= 0.0:
        nothing = tuple(np.zeros(g.shape[1]) for g in problem.groups)
        return Evidence(1.0, 0.0, np.zeros(len(bounds)), nothing, np.zeros_like(problem.residual), 0)
    p_value, rank = _gate(y, rest, triangle, bounds, problem.freedom)
    together = np.ones(len(bounds), dtype=bool)
    shared_value, shared_size = _best_size(
        y, rest, triangle, np.zeros(triangle.shape[1]), together, bounds, problem.freedom
    )
    sizes, value = np.full(len(bounds), shared_size), shared_value
    if len(bounds) > 1:
        sparse_sizes, sparse_value = _choose_members(y, rest, triangle, bounds, problem.freedom)
        if sparse_value > value:
            sizes, value = sparse_sizes, sparse_value
    spread = np.repeat(sizes, [b - a for a, b in bounds])
    weights = spread**2 * (
        triangle.T @ np.linalg.solve(np.eye(len(y)) + (triangle * spread**2) @ triangle.T, y)
    )
    explained = np.concatenate(problem.groups, axis=1) @ weights
    coefficients = tuple(weights[a:b] for a, b in bounds)
    return Evidence(p_value, max(value, 0.0), sizes, coefficients, explained, rank)


def _reduce(residual: Array, groups: tuple[Array, ...]) -> tuple[Array, float, Array, list[tuple[int, int]]]:
    """Q^T r, |r|^2 outside the columns' span, R, and each member's columns in R."""
    ends = np.cumsum([0, *(g.shape[1] for g in groups)])
    bounds = [(int(a), int(b)) for a, b in pairwise(ends)]
    q, triangle = np.linalg.qr(np.concatenate(groups, axis=1))
    y = q.T @ residual
    return y, max(float(residual @ residual) - float(y @ y), 0.0), triangle, bounds


def _f_test(y: Array, rest: float, columns: Array, freedom: int) -> tuple[float, int]:
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-6 * max(float(s[0]), 1e-300)] if len(s) and s[0] > 1e-9 else u[:, :0]
    rank = u.shape[1]
    left = freedom - rank
    if rank == 0 or left <= 0:
        return 1.0, rank
    explained = float(np.sum((u.T @ y) ** 2))
    unexplained = max(rest + float(y @ y) - explained, 1e-300)
    return float(f_distribution.sf(explained / rank / (unexplained / left), rank, left)), rank


def _gate(
    y: Array, rest: float, triangle: Array, bounds: list[tuple[int, int]], freedom: int
) -> tuple[float, int]:
    """The family's p: twice the smaller of its own and its best member's, the latter times the number of members."""
    whole, rank = _f_test(y, rest, triangle, freedom)
    if len(bounds) == 1:
        return whole, rank
    single = min(_f_test(y, rest, triangle[:, a:b], freedom)[0] for a, b in bounds)
    return min(1.0, 2.0 * min(whole, len(bounds) * single)), rank


def _best_size(
    y: Array,
    rest: float,
    triangle: Array,
    spread: Array,
    chosen: NDArray[np.bool_],
    bounds: list[tuple[int, int]],
    freedom: int,
) -> tuple[float, float]:
    """The best common size of the chosen members beside others of the given spread, and the log evidence there."""
    of = np.concatenate([np.arange(a, b) for (a, b), c in zip(bounds, chosen, strict=True) if c])
    others = np.setdiff1d(np.arange(triangle.shape[1]), of)
    cover = np.eye(len(y)) + (triangle[:, others] * spread[others] ** 2) @ triangle[:, others].T
    root = np.linalg.cholesky(cover)
    z = np.linalg.solve(root, y)
    u, s, _ = np.linalg.svd(np.linalg.solve(root, triangle[:, of]), full_matrices=False)
    h2, lam = (u.T @ z) ** 2, s**2
    grow = 1.0 + _SIZES[:, None] ** 2 * lam  # (sizes, K)
    quadratic = rest + float(z @ z) - np.sum(h2 * (1.0 - 1.0 / grow), axis=1)
    fixed = -float(np.sum(np.log(np.diag(root))))
    values = (
        fixed - 0.5 * np.sum(np.log(grow), axis=1) - 0.5 * freedom * np.log(quadratic / (rest + float(y @ y)))
    )
    best = int(np.argmax(values))
    return float(values[best]), float(_SIZES[best])


def _choose_members(
    y: Array, rest: float, triangle: Array, bounds: list[tuple[int, int]], freedom: int
) -> tuple[Array, float]:
    """Members added one by one while the evidence grows, sizes polished; the evidence after paying for the choice."""
    count = len(bounds)
    cost = float(np.log(count))
    sizes, value = np.zeros(count), 0.0

    def spread() -> Array:
        return np.repeat(sizes, [b - a for a, b in bounds])

    for _ in range(count):
        tried = []
        for g in np.flatnonzero(sizes == 0.0):
            alone = np.arange(count) == g
            tried.append((*_best_size(y, rest, triangle, spread(), alone, bounds, freedom), int(g)))
        if not tried:
            break
        best_value, best_size, member = max(tried)
        if best_value < value + cost + _GAIN:
            break
        sizes[member], value = best_size, best_value
        for member in map(
            int, np.flatnonzero(sizes)
        ):  # once around: earlier sizes were chosen without this one
            chosen = np.arange(count) == member
            value, sizes[member] = _best_size(y, rest, triangle, spread(), chosen, bounds, freedom)
    return sizes, value - cost * int(np.count_nonzero(sizes))


def holm(p_values: list[float]) -> list[float]:
    """Holm's step-down correction, in the order given."""
    order = np.argsort(p_values)
    out = np.empty(len(p_values))
    running = 0.0
    for rank, i in enumerate(order):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[i]))
        out[i] = running
    return out.tolist()
