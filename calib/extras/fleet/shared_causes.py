"""Causes that several arms of a fleet share, and properties that these arms have in common.

A cause is an effect on one joint that a diagnosis claims, or that it suspects or leaves open with a probability of a
half or more; of several datasets of an arm the mean counts, the last one twice. Its arms are compared with every site,
every value of a further key of [about] (a gear's batch), and every range of serial numbers and of dates by Fisher's
exact test, one-sided: is the share of arms with this cause larger in the group than in the rest of the fleet's arms of
that model? Models are compared with each other in the same way. A range is the best of all ranges, so its p-value is
the probability of a range as good where the cause is permuted at random (or Bonferroni's over all ranges, where that is
less); a range up to the last number or date has a weight of `SINCE_WEIGHT`, as a new batch shows so. All tests of a
fleet are corrected together (Holm 1979).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import special

from calib.array_types import Array, BoolArray, IndexArray
from calib.extras.fleet.row import EffectSize, Row
from calib.rendering import numbers

FEWEST = 3  # arms that make a cause shared
MAIN_SHARE = 0.25  # of the displacement by an effect's largest member, from which another joint carries it too
LIKELY = 0.5  # probability from which an arm counts as one with the cause
LEVEL = 0.05  # family-wise error rate of the groups that are reported
SINCE_WEIGHT = 4.0  # of a range up to the last arm, beside 1 of the others
PERMUTATIONS = 999

Cause = tuple[str, int | None]  # effect, joint counted from 1


@dataclass(frozen=True)
class Group:
    """Arms of one site, batch or range of serial numbers that have a cause more often than the other arms."""

    what: str  # "site", "serial numbers", "serial numbers since", "dates", "dates since", "robot", or a key of [about]
    value: str
    inside: tuple[int, int]  # arms with the cause, all arms
    outside: tuple[int, int]
    p_value: float  # family-wise (Holm), over all tests

    @classmethod
    def of(cls, what: str, value: str, inside: BoolArray, has: BoolArray, p_value: float) -> Group:
        """Group by which arms (N,) are inside, and which have the cause."""
        with_it, without = ((int(has[part].sum()), int(part.sum())) for part in (inside, ~inside))
        return cls(what, value, with_it, without, p_value)


@dataclass(frozen=True)
class SharedCause:
    """An effect on one joint that several arms have."""

    robot: str  # "" where models are compared with each other
    effect: str
    joint: int | None
    arms: tuple[str, ...]  # serial numbers, or paths in brackets
    of: int  # arms of that model
    moves_mm: float  # median over the arms
    groups: tuple[Group, ...]  # those that stand out, the surest first


def shared_causes(rows: Iterable[Row]) -> tuple[SharedCause, ...]:
    """Causes that at least FEWEST arms share, sorted by significance of a group, then by number of arms."""
    rows_of: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in sorted(rows, key=lambda row: (row.date, row.path)):
        if row.verdict:
            rows_of[row.arm].append(row)
    arms = [rows_of[arm] for arm in sorted(rows_of, key=lambda arm: (arm[0], numbers.natural_order(arm[1])))]
    found: list[tuple[SharedCause, list[Group]]] = []
    for robot in [*dict.fromkeys(of_arm[0].robot for of_arm in arms), ""]:
        of_robot = [of_arm for of_arm in arms if robot in ("", of_arm[0].robot)]
        last = [of_arm[-1] for of_arm in of_robot]
        sizes = [_causes(of_arm) for of_arm in of_robot]
        for cause in sorted({c for s in sizes for c in s}, key=lambda c: (c[0], c[1] or 0)):
            has = np.array([cause in s for s in sizes])
            if has.sum() >= FEWEST:
                names = tuple(last[k].arm[1] for k in np.flatnonzero(has))
                moves_mm = float(np.median([s[cause].moves_mm for s in sizes if cause in s]))
                shared = SharedCause(robot, *cause, names, len(has), moves_mm, ())
                found.append((shared, _groups(last, has, across_models=not robot)))
    corrected = iter(_corrected([group.p_value for _, groups in found for group in groups]))
    out = []
    for shared, groups in found:
        surest = sorted(
            (replace(group, p_value=next(corrected)) for group in groups),
            key=lambda group: (group.p_value, -group.inside[0], group.what),
        )
        shared = replace(shared, groups=tuple(group for group in surest if group.p_value < LEVEL))
        if shared.robot or shared.groups:
            out.append(shared)
    return tuple(sorted(out, key=lambda c: (not c.groups, -len(c.arms), c.robot, c.effect, c.joint or 0)))


def _corrected(p_values: Sequence[float]) -> list[float]:
    """p-values corrected by Holm's step-down procedure."""
    order = np.argsort(p_values)
    out = np.empty(len(order))
    out[order] = np.minimum(np.maximum.accumulate(np.sort(p_values) * np.arange(len(order), 0, -1)), 1.0)
    return [float(p) for p in out]


def _causes(rows: Sequence[Row]) -> dict[Cause, EffectSize]:
    """Causes that an arm has by all its datasets, in order of their dates, with the size of the last."""
    of_each = [_main_sizes(row) for row in rows]
    likely: dict[Cause, EffectSize] = {}
    for cause, size in {cause: size for found in of_each for cause, size in found.items()}.items():
        p = [
            0.0 if cause not in found else 1.0 if cause[0] in row.missing else row.likely.get(cause[0], 0.0)
            for row, found in zip(rows, of_each, strict=True)
        ]
        if np.mean([*p, p[-1]]) >= LIKELY:
            likely[cause] = size
    return likely


def _main_sizes(row: Row) -> dict[Cause, EffectSize]:
    """Size of each effect in a dataset's last model, without joints with a negligible share."""
    most: dict[str, float] = defaultdict(float)
    for size in row.sizes:
        most[size.effect] = max(most[size.effect], size.moves_mm)
    return {(s.effect, s.joint): s for s in row.sizes if s.moves_mm >= MAIN_SHARE * most[s.effect]}


def _groups(arms: Sequence[Row], has: BoolArray, *, across_models: bool) -> list[Group]:
    """Groups of arms (site, lot, serial range) with uncorrected p-values for having a cause more often."""
    table, out = log_fisher(len(arms), int(has.sum())), []
    keys = [{"robot": r.robot} if across_models else {"site": r.site, **r.about} for r in arms]
    for what in sorted({key for row_keys in keys for key in row_keys}):
        values = np.array([row_keys.get(what, "") for row_keys in keys])
        for value in np.unique(values[values != ""]).tolist():
            inside = values == value
            if 2 <= inside.sum() < len(arms):
                p = float(np.exp(table[inside.sum(), has[inside].sum()]))
                out.append(Group.of(what, value, inside, has, p))
    ordered = {} if across_models else {"serial numbers": [r.serial for r in arms], "dates": [r.date for r in arms]}
    for what, names in ordered.items():
        order = sorted((k for k, name in enumerate(names) if name), key=lambda k: numbers.natural_order(names[k]))
        named = [names[k] for k in order]
        if has[order].sum() >= FEWEST and len(set(named)) > FEWEST:
            first, end, p = best_range(has[order], np.unique(named, return_index=True)[1])
            inside = np.isin(np.arange(len(order)), np.arange(first, end))
            if 2 <= inside.sum() < len(order):
                since = end == len(order)
                value = named[first] if since else f"{named[first]} to {named[end - 1]}"
                out.append(Group.of(f"{what} since" if since else what, value, inside, has[order], p))
    return out


@lru_cache(maxsize=4)
def log_fisher(population: int, cases: int) -> Array:
    """Table (population + 1, cases + 1) of log P(at least k cases among w drawn without replacement).

    Rows are w, columns k; Fisher's exact test of a group of w with k cases is one entry (one-sided). For 5,000 arms
    scipy.stats.hypergeom takes 80 times as long.
    """
    drawn, found = np.arange(population + 1)[:, None], np.arange(cases + 1)

    def log_choose(n: int, k: IndexArray) -> Array:
        """Logarithm of the ways to choose k of n, minus infinity where there is none."""
        return np.asarray(special.gammaln(n + 1.0) - special.gammaln(k + 1.0) - special.gammaln(n - k + 1.0))

    rest = log_choose(population - cases, drawn - found)
    log_p = log_choose(cases, found) + rest - log_choose(population, drawn)
    return np.asarray(np.minimum(np.logaddexp.accumulate(log_p[:, ::-1], axis=1)[:, ::-1], 0.0))


def best_range(has: BoolArray, starts: IndexArray) -> tuple[int, int, float]:
    """Range of an order in which a cause is least likely by chance: first index, end, and p-value.

    `has` (N,) says which arms have the cause, in order, `starts` the places at which a range may begin or end: a day is
    not split. The p-value is the probability of a range as unlikely anywhere, where the cases are permuted at random:
    of all permutations where they are few, else of `PERMUTATIONS`, or Bonferroni's bound where that is less.
    """
    from scipy.stats import permutation_test  # which takes a quarter of a second to load

    n, cases = len(has), int(has.sum())
    table, starts = log_fisher(n, cases), np.append(np.sort(starts), n)

    def ranges(places: IndexArray) -> tuple[IndexArray, IndexArray, Array]:
        """First index (K,) and end (L,) of the ranges about the cases, and log p less that of the weight (K, L)."""
        first = starts[np.unique(np.searchsorted(starts, places, "right")) - 1]
        end = np.unique([*starts[np.searchsorted(starts, places, "right")], n])
        count = np.searchsorted(places, end) - np.searchsorted(places, first)[:, None]
        width = end - first[:, None]
        log_p = table[np.maximum(width, 0), np.maximum(count, 0)]
        return first, end, np.asarray(log_p - np.where(end == n, np.log(SINCE_WEIGHT), 0.0))

    def least(places: IndexArray, _: IndexArray) -> float:
        return float(ranges(np.sort(places))[2].min())

    first, end, log_p = ranges(np.flatnonzero(has))
    i, j = np.unravel_index(int(np.argmin(log_p)), log_p.shape)
    p = float(np.exp(log_p[i, j]) * (n * (n - 1) / 2 + SINCE_WEIGHT * n))
    if p > 1.0 / (1 + PERMUTATIONS):
        found = permutation_test(
            (np.flatnonzero(has), np.flatnonzero(~has)), least, n_resamples=PERMUTATIONS, alternative="less", rng=0
        )
        p = min(p, float(found.pvalue))
    return int(first[i]), int(end[j]), p
