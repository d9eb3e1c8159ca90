"""Causes that several arms of a fleet share, and properties that these arms have in common.

A cause is an effect on one joint that a diagnosis claims, or that it suspects or leaves open with a probability of a
half or more; of several datasets of an arm the mean counts, the last one twice. Is the share of arms with this cause
larger in a site, or with a value of a further key of [about] (a gear's batch), than in the rest of the fleet's arms of
that model? That is Fisher's exact test, one-sided. All tests of a fleet are corrected together (Holm 1979).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import BoolArray
from calib.extras.fleet.row import EffectSize, Row
from calib.rendering import numbers
from calib.screening.evidence import holm

FEWEST = 3  # arms that make a cause shared
MAIN_SHARE = 0.25  # of the displacement by an effect's largest member, from which another joint carries it too
LIKELY = 0.5  # probability from which an arm counts as one with the cause
LEVEL = 0.05  # family-wise error rate of the groups that are reported

Cause = tuple[str, int | None]  # effect, joint counted from 1


@dataclass(frozen=True)
class Group:
    """Arms of one site or batch that have a cause more often than the other arms."""

    what: str  # "site", or a key of [about]
    value: str
    inside: tuple[int, int]  # arms with the cause, all arms
    outside: tuple[int, int]
    p_value: float  # family-wise (Holm), over all tests


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
                found.append(SharedCause(robot, *cause, names, len(has), moves_mm, _groups(last, has)))
    corrected = iter(holm([group.p_value for cause in found for group in cause.groups]))
    told = []
    for shared in found:
        groups = [replace(group, p_value=next(corrected)) for group in shared.groups]
        surest = sorted(groups, key=lambda group: (group.p_value, -group.inside[0], group.what))
        told.append(replace(shared, groups=tuple(group for group in surest if group.p_value < LEVEL)))
    return tuple(sorted(told, key=lambda c: (not c.groups, -len(c.arms), c.robot, c.effect, c.joint or 0)))


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


def _groups(arms: Sequence[Row], has: BoolArray) -> tuple[Group, ...]:
    """Groups of arms of a site, or of a value of a key of [about], with uncorrected p-values."""
    from scipy.stats import hypergeom  # which takes a quarter of a second to load

    keys, out = [{"site": row.site, **row.about} for row in arms], []
    for what in sorted(set().union(*keys)):
        values, group = np.unique([row_keys.get(what, "") for row_keys in keys], return_inverse=True)
        with_it, count = np.bincount(group, has).astype(int), np.bincount(group)
        p_values = np.asarray(hypergeom.sf(with_it - 1, len(arms), has.sum(), count))
        for value, a, n, p in zip(values.tolist(), with_it.tolist(), count.tolist(), p_values.tolist(), strict=True):
            if value and 2 <= n < len(arms):
                out.append(Group(what, value, (a, n), (int(has.sum()) - a, len(arms) - n), p))
    return tuple(out)
