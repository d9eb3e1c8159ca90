"""Causes that several arms of a fleet share, and properties that these arms have in common.

A cause is an effect on one joint that a diagnosis claims, or that it suspects or leaves open with a probability of a
half or more; of several datasets of an arm the mean counts. Its arms are compared with every site, every value of a
further key of [about] (a gear's batch), all arms since a serial number or a date, and every range of serial numbers by
Fisher's exact test, one-sided: is the share of arms with this cause larger in the group than in the rest of the fleet's
arms of that model? Models are compared with each other in the same way. A range is the best of all ranges, so its
p-value is the probability of a range as good where the cause is permuted at random (or Bonferroni's over all ranges,
where that is less). All tests of a fleet are corrected together (Holm), those of a change since some number with the
weight `SINCE_WEIGHT`, as a new batch shows so.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from math import comb

import numpy as np
from scipy import special

from calib.array_types import Array, BoolArray, IndexArray
from calib.extras.fleet.row import EffectSize, Row
from calib.rendering import numbers

FEWEST = 3  # arms that make a cause shared
MAIN_SHARE = 0.25  # of the displacement by an effect's largest member, from which another joint carries it too
LIKELY = 0.5  # probability from which an arm counts as one with the cause
LEVEL = 0.05  # family-wise error rate of the groups that are reported
SINCE_WEIGHT = 4.0  # of the tests of all arms since a serial number or a date, beside 1 of the others
PERMUTATIONS = 999
_ENOUGH = 20  # permutations as good as the data's, after which the p-value is known well enough

_EXACT = 1000  # most ways to deal out a cause that are all tried
SERIALS_SINCE, DATES_SINCE = "serial numbers since", "dates since"

Cause = tuple[str, int | None]  # effect, joint counted from 1


@dataclass(frozen=True)
class Group:
    """Arms of one site, batch or range of serial numbers that have a cause more often than the other arms."""

    what: str  # "site", "serial numbers", "serial numbers since", "dates since", "robot", or a key of [about]
    value: str
    inside: tuple[int, int]  # arms with the cause, all arms
    outside: tuple[int, int]
    p_value: float  # family-wise (Holm), over all tests


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
    tests: list[tuple[int, Group]] = []
    found: list[SharedCause] = []
    for robot, of_robot in [*_by_robot(arms).items(), ("", arms)]:
        sizes = [_causes(row) for row in of_robot]
        for cause in sorted({c for s in sizes for c in s}, key=lambda c: (c[0], c[1] or 0)):
            has = np.array([cause in s for s in sizes])
            if has.sum() < FEWEST:
                continue
            moved = [s[cause].moves_mm for s in sizes if cause in s]
            last = [rows[-1] for rows in of_robot]
            names = tuple(row.arm[1] for row, with_it in zip(last, has, strict=True) if with_it)
            tests += [(len(found), group) for group in _groups(last, has, across_models=not robot)]
            found.append(SharedCause(robot, *cause, names, len(has), float(np.median(moved)), ()))
    groups: dict[int, list[Group]] = defaultdict(list)
    for (index, group), p in zip(tests, _corrected([group for _, group in tests]), strict=True):
        if p < LEVEL:
            groups[index].append(replace(group, p_value=p))
    out = [
        replace(cause, groups=tuple(sorted(groups[i], key=lambda g: (g.p_value, -g.inside[0], g.what))))
        for i, cause in enumerate(found)
        if cause.robot or groups[i]
    ]
    return tuple(sorted(out, key=lambda c: (not c.groups, -len(c.arms), c.robot, c.effect, c.joint or 0)))


def _corrected(groups: Sequence[Group]) -> list[float]:
    """p-values of groups corrected by Holm's step-down procedure with weights (Holm 1979)."""
    weights = np.array([SINCE_WEIGHT if group.what in (SERIALS_SINCE, DATES_SINCE) else 1.0 for group in groups])
    p = np.array([group.p_value for group in groups])
    order = np.argsort(p / weights)
    left = np.cumsum(weights[order][::-1])[::-1]
    corrected = np.minimum(np.maximum.accumulate(left * p[order] / weights[order]), 1.0) if len(p) else p
    out = np.empty(len(p))
    out[order] = corrected
    return [float(value) for value in out]


def _by_robot(arms: Sequence[list[Row]]) -> dict[str, list[list[Row]]]:
    out: dict[str, list[list[Row]]] = defaultdict(list)
    for rows in arms:
        out[rows[0].robot].append(rows)
    return out


def _causes(rows: Sequence[Row]) -> dict[Cause, EffectSize]:
    """Causes that an arm has by all its datasets, in order of their dates, with the size of the last."""
    of_each = [_causes_of(row) for row in rows]
    sizes = {cause: size for found in of_each for cause, (size, _) in found.items()}
    likely: dict[Cause, EffectSize] = {}
    for cause, size in sizes.items():
        p = [found[cause][1] if cause in found else 0.0 for found in of_each]
        if np.mean(p) > LIKELY or (np.mean(p) == LIKELY and p[-1] >= LIKELY):
            likely[cause] = size
    return likely


def _causes_of(row: Row) -> dict[Cause, tuple[EffectSize, float]]:
    """Size and probability of each effect in a dataset's last model, without joints with a negligible share."""
    claimed = row.sizes
    most = {
        effect: max(size.moves_mm for size in claimed if size.effect == effect)
        for effect in {size.effect for size in claimed}
    }

    def probability(effect: str) -> float:
        return 1.0 if effect in row.missing else row.likely.get(effect, 0.0)

    return {
        (s.effect, s.joint): (s, probability(s.effect)) for s in claimed if s.moves_mm >= MAIN_SHARE * most[s.effect]
    }


def _groups(arms: Sequence[Row], has: BoolArray, *, across_models: bool) -> list[Group]:
    """Groups of arms (site, lot, serial range) with uncorrected p-values for having a cause more often."""
    population, cases = len(arms), int(has.sum())
    table = hypergeometric_sf(population, cases)

    def group(what: str, value: str, inside: BoolArray, p_value: float | None = None) -> Group:
        size, count = int(inside.sum()), int((inside & has).sum())
        p = float(table[size, count]) if p_value is None else p_value
        return Group(what, value, (count, size), (cases - count, population - size), p)

    out = []
    keys = [{"robot": r.robot} if across_models else {"site": r.site, **r.about} for r in arms]
    for what in sorted({key for row_keys in keys for key in row_keys}):
        values = np.array([row_keys.get(what, "") for row_keys in keys])
        for value in np.unique(values[values != ""]).tolist():
            inside = values == value
            if 2 <= inside.sum() < population:
                out.append(group(what, value, inside))
    numbered = np.array([bool(row.serial) for row in arms])
    if not across_models and has[numbered].sum() >= FEWEST and numbered.sum() > FEWEST:
        places = np.flatnonzero(numbered)
        first, last, p = best_range(has[numbered])
        inside = np.zeros(population, dtype=bool)
        inside[places[first : last + 1]] = True
        value = f"{arms[places[first]].serial} to {arms[places[last]].serial}"
        if 2 <= inside.sum() < numbered.sum():
            out.append(group("serial numbers", value, inside, p))
        out += _since(arms, has, places, SERIALS_SINCE, lambda row: row.serial)
    dated = [i for i in range(population) if arms[i].date]
    if not across_models and has[dated].sum() >= FEWEST and len({arms[i].date for i in dated}) > FEWEST:
        in_time = np.array(sorted(dated, key=lambda i: (arms[i].date, i)))
        out += _since(arms, has, in_time, DATES_SINCE, lambda row: row.date)
    return out


@lru_cache(maxsize=4)
def hypergeometric_sf(population: int, cases: int) -> Array:
    """Table (population + 1, cases + 1) of P(at least k cases among w drawn without replacement).

    Rows are w, columns k; Fisher's exact test of a group of w with k cases is one entry (one-sided). For 5,000 arms
    scipy.stats.hypergeom takes 80 times as long.
    """
    drawn, found = np.arange(population + 1)[:, None], np.arange(cases + 1)

    def log_choose(n: int, k: IndexArray) -> Array:
        """Logarithm of the ways to choose k of n, minus infinity where there is none."""
        return np.asarray(special.gammaln(n + 1.0) - special.gammaln(k + 1.0) - special.gammaln(n - k + 1.0))

    rest = log_choose(population - cases, drawn - found)
    p = np.exp(log_choose(cases, found) + rest - log_choose(population, drawn))
    return np.asarray(np.minimum(np.cumsum(p[:, ::-1], axis=1)[:, ::-1], 1.0))


def _since(
    arms: Sequence[Row], has: BoolArray, order: IndexArray, what: str, name: Callable[[Row], str]
) -> list[Group]:
    """Arms since the place in an order from which a cause is most frequent against the arms before; [] for all arms."""
    values = [name(arms[i]) for i in order]
    starts = np.array([k == 0 or values[k - 1] != value for k, value in enumerate(values)])  # a day is not split
    first, p = best_since(has[order], starts)
    if not 2 <= len(order) - first < len(order):
        return []
    count, size, cases = int(has[order[first:]].sum()), len(order) - first, int(has[order].sum())
    return [Group(what, values[first], (count, size), (cases - count, len(order) - size), p)]


def best_since(has: BoolArray, starts: BoolArray) -> tuple[int, float]:
    """Place in an order since which a cause is most frequent by Fisher's test, and the p-value of that.

    `has` (N,) says which arms have the cause, in order, `starts` (N,) at which of them a group may begin. The p-value
    is the probability of a place as unlikely anywhere, where the cases are permuted at random: exact where few arms
    have it, by `PERMUTATIONS` else.
    """
    n, cases = len(has), int(has.sum())
    table = hypergeometric_sf(n, cases)

    def best(having: BoolArray) -> tuple[float, int]:
        behind = np.cumsum(having[::-1])[::-1]
        p = np.where(starts, table[n - np.arange(n), behind], 1.0)
        first = int(np.argmin(p))
        return float(p[first]), first

    p, first = best(has)
    if comb(n, cases) <= _EXACT:
        as_good = 0
        for places in combinations(range(n), cases):
            having = np.zeros(n, dtype=bool)
            having[list(places)] = True
            as_good += best(having)[0] <= p * (1.0 + 1e-9)
        return first, as_good / comb(n, cases)
    return first, permuted_p(lambda rng: best(rng.permutation(has))[0], p, bonferroni=p * n)


def permuted_p(drawn: Callable[[np.random.Generator], float], p: float, *, bonferroni: float) -> float:
    """Probability of a least p-value as small under random permutations; Bonferroni's bound where that is less.

    The draws end where enough are as small (Besag, Clifford 1991); none is needed where the bound is below them all.
    """
    if bonferroni < 1.0 / (1 + PERMUTATIONS):
        return bonferroni
    rng = np.random.default_rng(0)
    as_good = 0
    for count in range(1, PERMUTATIONS + 1):
        as_good += drawn(rng) <= p * (1.0 + 1e-9)
        if as_good == _ENOUGH:
            return min(as_good / count, bonferroni)
    return min((1 + as_good) / (1 + PERMUTATIONS), bonferroni)


def best_range(has: BoolArray) -> tuple[int, int, float]:
    """Range of serial numbers in which a cause is least likely by chance: first and last index, and p-value.

    `has` (N,) says which arms have the cause, in order. The p-value is the probability of a range as unlikely anywhere,
    where the cases are permuted at random.
    """
    n, cases = len(has), int(has.sum())
    table = hypergeometric_sf(n, cases)

    among = np.arange(2, cases + 1)

    def narrowest(places: IndexArray) -> IndexArray:
        """Least width (cases - 1,) of a range with 2, 3, ... of the cases: of these ranges it is the unlikeliest."""
        return np.array([(places[k - 1 :] - places[: cases - k + 1]).min() + 1 for k in among], dtype=np.intp)

    places = np.flatnonzero(has)
    width = narrowest(places)
    p_values = table[width, among]
    # Where several are as unlikely, or all below what a float holds, the one with most cases above its share.
    best = int(np.lexsort((-(among - width * (cases / n)), p_values))[0])
    p, k = float(p_values[best]), int(among[best])
    start = int(np.argmin(places[k - 1 :] - places[: cases - k + 1]))
    first, last = int(places[start]), int(places[start + k - 1])

    def drawn(rng: np.random.Generator) -> float:
        return float(table[narrowest(np.sort(rng.permutation(n)[:cases])), among].min())

    return first, last, permuted_p(drawn, p, bonferroni=p * n * (n + 1) / 2)
