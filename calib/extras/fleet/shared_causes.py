"""Causes that several arms of a fleet share, and properties that these arms have in common.

A cause is an effect on one joint that a diagnosis claims, or that it suspects or leaves open with a probability of a
half or more; of several datasets of an arm the mean counts, the last one twice. Is the share of arms with this cause
larger in a site, or with a value of a further key of [about] (a gear's batch), than in the rest of the fleet's arms of
that model? That is Fisher's exact test, one-sided. In which range of serial numbers, or of dates, does the share of the
arms with the cause grow most above that of the others? Three tests, corrected for each other, say whether that is
chance: by how much it grows, where the cause is permuted at random, and the tests of Kolmogorov and Smirnov, two-sided
and one-sided, as a new batch is in all arms since a number. All tests of a fleet are corrected together (Holm 1979).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.extras.fleet.row import EffectSize, Row
from calib.rendering import numbers
from calib.screening.evidence import holm

FEWEST = 3  # arms that make a cause shared
MAIN_SHARE = 0.25  # of the displacement by an effect's largest member, from which another joint carries it too
LIKELY = 0.5  # probability from which an arm counts as one with the cause
PERMUTATIONS = 999
_MANY = 1000  # arms, from which the limit of that distribution holds
LEVEL = 0.05  # family-wise error rate of the groups that are reported

Cause = tuple[str, int | None]  # effect, joint counted from 1


@dataclass(frozen=True)
class Group:
    """Arms of one site, batch or range of serial numbers that have a cause more often than the other arms."""

    what: str  # "site", "serial numbers", "serial numbers since", "dates", "dates since", or a key of [about]
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

    robot: str
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
    found: list[SharedCause] = []
    for robot in sorted({robot for robot, _ in rows_of}):
        of_robot = [arm for arm in rows_of if arm[0] == robot]
        arms = [rows_of[arm] for arm in sorted(of_robot, key=lambda arm: numbers.natural_order(arm[1]))]
        last, sizes = [of_arm[-1] for of_arm in arms], [_causes(of_arm) for of_arm in arms]
        for cause in sorted({c for s in sizes for c in s}, key=lambda c: (c[0], c[1] or 0)):
            has = np.array([cause in s for s in sizes])
            if has.sum() >= FEWEST:
                names = tuple(last[k].arm[1] for k in np.flatnonzero(has))
                moves_mm = float(np.median([s[cause].moves_mm for s in sizes if cause in s]))
                groups = (*_places(last, has), *_ranges(last, has))
                found.append(SharedCause(robot, *cause, names, len(has), moves_mm, groups))
    corrected = iter(holm([group.p_value for cause in found for group in cause.groups]))
    for k, shared in enumerate(found):
        surest = sorted(
            (replace(group, p_value=next(corrected)) for group in shared.groups),
            key=lambda group: (group.p_value, -group.inside[0], group.what),
        )
        found[k] = replace(shared, groups=tuple(group for group in surest if group.p_value < LEVEL))
    return tuple(sorted(found, key=lambda c: (not c.groups, -len(c.arms), c.robot, c.effect, c.joint or 0)))


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


def _places(arms: Sequence[Row], has: BoolArray) -> list[Group]:
    """Groups of arms of a site, or of a value of a key of [about], with uncorrected p-values."""
    from scipy.stats import hypergeom  # which takes a quarter of a second to load

    keys, out = [{"site": row.site, **row.about} for row in arms], []
    for what in sorted(set().union(*keys)):
        values = np.array([row_keys.get(what, "") for row_keys in keys])
        for value in np.unique(values[values != ""]).tolist():
            inside = values == value
            if 2 <= inside.sum() < len(arms):
                p = hypergeom.sf(has[inside].sum() - 1, len(arms), has.sum(), inside.sum())
                out.append(Group.of(what, value, inside, has, float(p)))
    return out


def _ranges(arms: Sequence[Row], has: BoolArray) -> list[Group]:
    """Range of serial numbers and range of dates in which arms have the cause, with uncorrected p-values."""
    from scipy.stats import ks_2samp, permutation_test

    out = []
    for what, names in (("serial numbers", [row.serial for row in arms]), ("dates", [row.date for row in arms])):
        place = {name: k for k, name in enumerate(sorted({*names} - {""}, key=numbers.natural_order))}
        known = [k for k, name in enumerate(names) if name]
        of_known, at = has[known], np.array([place[names[k]] for k in known], dtype=np.int64)
        if of_known.sum() < FEWEST or of_known.all() or len(place) <= FEWEST:
            continue
        parts, order = (at[of_known], at[~of_known]), list(place)
        by_chance = permutation_test(
            parts, lambda *of: _growth(*of)[1].max(), n_resamples=PERMUTATIONS, alternative="greater", rng=0
        )
        method: Literal["exact", "asymp"] = "exact" if len(known) < _MANY else "asymp"
        since, anywhere = ks_2samp(*parts, "less", method), ks_2samp(*parts, "two-sided", method)
        p_values = [by_chance.pvalue, since.pvalue, anywhere.pvalue]
        lead, growth = _growth(*parts)
        end = int(np.argmax(growth))
        first, is_last = int(np.argmin(lead[:end])), end == len(order)
        inside = (at >= first) & (at < end)
        value = order[first] if is_last else f"{order[first]} to {order[end - 1]}"
        p = min(len(p_values) * float(min(p_values)), 1.0)
        out.append(Group.of(f"{what} since" if is_last else what, value, inside, of_known, p))
    return out


def _growth(with_it: IndexArray, without: IndexArray) -> tuple[Array, Array]:
    """Share of the arms with a cause less that of the others before each place in an order, and its growth to there."""
    count = 1 + max(int(with_it.max()), int(without.max()))
    shares = (np.bincount(of, minlength=count) / len(of) for of in (with_it, without))
    lead = np.round(np.append(0.0, np.subtract(*shares).cumsum()), 9)
    return lead, lead - np.minimum.accumulate(lead)
