"""Causes that several arms of a fleet share, and properties that these arms have in common.

A cause is an effect on one joint that a diagnosis claims. Its arms are compared with every site, every value of a
further key of [about] (a gear's batch), and every range of serial numbers by Fisher's exact test, one-sided: is the
share of arms with this cause larger in the group than in the rest of the fleet's arms of that model? Models are
compared with each other in the same way. A range is the best of all ranges, so its p-value is the probability of a
range as good where the cause is permuted at random (or Bonferroni's over all ranges, where that is less). All tests of
a fleet are corrected together (Holm).
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import BoolArray, IndexArray
from calib.distributions import hypergeometric_sf
from calib.fleet.row import EffectSize, Row
from calib.screening.evidence import holm

FEWEST = 3  # arms that make a cause shared
MAIN_SHARE = 0.25  # of the displacement by an effect's largest member, from which another joint carries it too
LEVEL = 0.01  # family-wise error rate of the groups that are reported
PERMUTATIONS = 999

Cause = tuple[str, int | None]  # effect, joint counted from 1


@dataclass(frozen=True)
class Group:
    """Arms of one site, batch or range of serial numbers that have a cause more often than the other arms."""

    what: str  # "site", "serial numbers", "robot", or a key of [about]
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
    last_of: dict[tuple[str, str], Row] = {}
    for row in sorted(rows, key=lambda row: (row.date, row.path)):
        if row.verdict:
            last_of[row.arm] = row
    arms = [last_of[arm] for arm in sorted(last_of, key=lambda arm: (arm[0], natural(arm[1])))]
    tests: list[tuple[int, Group]] = []
    found: list[SharedCause] = []
    for robot, of_robot in [*_by_robot(arms).items(), ("", arms)]:
        sizes = [_causes(row) for row in of_robot]
        for cause in sorted({c for s in sizes for c in s}, key=lambda c: (c[0], c[1] or 0)):
            has = np.array([cause in s for s in sizes])
            if has.sum() < FEWEST:
                continue
            moved = [s[cause].moves_mm for s in sizes if cause in s]
            names = tuple(row.arm[1] for row, with_it in zip(of_robot, has, strict=True) if with_it)
            tests += [(len(found), group) for group in _groups(of_robot, has, across_models=not robot)]
            found.append(SharedCause(robot, *cause, names, len(has), float(np.median(moved)), ()))
    groups: dict[int, list[Group]] = defaultdict(list)
    for (index, group), p in zip(tests, holm([group.p_value for _, group in tests]), strict=True):
        if p < LEVEL:
            groups[index].append(replace(group, p_value=p))
    out = [
        replace(cause, groups=tuple(sorted(groups[i], key=lambda g: (g.p_value, -g.inside[0], g.what))))
        for i, cause in enumerate(found)
        if cause.robot or groups[i]
    ]
    return tuple(sorted(out, key=lambda c: (not c.groups, -len(c.arms), c.robot, c.effect, c.joint or 0)))


def _by_robot(arms: Sequence[Row]) -> dict[str, list[Row]]:
    out: dict[str, list[Row]] = defaultdict(list)
    for row in arms:
        out[row.robot].append(row)
    return out


def _causes(row: Row) -> dict[Cause, EffectSize]:
    """Effects claimed by an arm's diagnosis, by effect and joint, without joints with a negligible share."""
    claimed = [size for size in row.sizes if size.effect in row.missing]
    most = {
        effect: max(size.moves_mm for size in claimed if size.effect == effect)
        for effect in {size.effect for size in claimed}
    }
    return {(s.effect, s.joint): s for s in claimed if s.moves_mm >= MAIN_SHARE * most[s.effect]}


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
    return out


def best_range(has: BoolArray) -> tuple[int, int, float]:
    """Range of serial numbers in which a cause is least likely by chance: first and last index, and p-value.

    `has` (N,) says which arms have the cause, in order. The p-value is the probability of a range as unlikely anywhere,
    where the cases are permuted at random.
    """
    n, cases = len(has), int(has.sum())
    table = hypergeometric_sf(n, cases)

    def best(places: IndexArray) -> tuple[float, int, int]:
        count = np.arange(len(places))
        among = count[None, :] - count[:, None] + 1
        width = places[None, :] - places[:, None] + 1
        p = np.where(among >= 2, table[np.maximum(width, 0), np.maximum(among, 0)], 1.0)
        i, j = np.unravel_index(int(np.argmin(p)), p.shape)
        return float(p[i, j]), int(places[i]), int(places[j])

    p, first, last = best(np.flatnonzero(has))
    rng = np.random.default_rng(0)
    as_good = sum(best(np.sort(rng.permutation(n)[:cases]))[0] <= p * (1.0 + 1e-9) for _ in range(PERMUTATIONS))
    return first, last, min((1 + as_good) / (1 + PERMUTATIONS), p * n * (n + 1) / 2)


def natural(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key that orders numbers within texts by value, so that "A-9" comes before "A-10"."""
    return tuple((0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", text) if part)
