"""Sizes from which changes of a cell will be found, and named alone, by check poses that are not measured yet.

The checks are linear in the points, so the verdict of `watch` can be drawn without points: the whitened residual of a
changed cell is the change's own columns times its size, plus normal numbers. Each draw is judged by the tests, rivals
and thresholds of `watch` itself: *found* where the family-wise test alarms, *named alone* where the change has the
highest score of all that watch tests, passes its level with the scanner's frame free, and no other change is said to
be as likely.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from calib.array_types import Array, BoolArray, IndexArray
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.extras.watch.cell import CellTests
from calib.extras.watch.change_models import SCANNER, ChangeModel
from calib.extras.watch.change_tests import (
    ALARM,
    ALONE,
    CONFOUNDED,
    NAMED,
    NAMED_GIVEN_OTHERS,
    PER_PARAMETER,
    ChangeTest,
    ChangeTests,
    family_wise_p_value,
    weight,
)

Key = tuple[str, int | None, str]

PROMISED = 0.95  # share of the checks in which a change of the promised size is found, or named
_DRAWS = 2000
_SOMEWHAT_BELOW = 0.7  # share of the size that is named alone, at which the rivals are looked at
_LARGEST = 64.0  # times the size that is found, above which a change counts as never named
_PRECISION = 1.01  # ratio to which a size is known
_NONE, _VAST = 1e-12, 1e6  # sizes that nothing shows, and beyond all that happens, in mm, rad or whatever the unit is


@dataclass(frozen=True)
class PromisedSize:
    """Least sizes of one change with a verdict that holds 19 times of 20.

    A vector is found in its worst direction, and named in directions drawn at random: some of them are other changes.
    """

    model: ChangeModel
    found: float | None  # something is said to have changed; None: these poses never show the change
    named: float | None  # this change and no other is named, though others may be said to be as likely; None: never
    alone: float | None  # it is named, and no other is said to be as likely; None: never
    rival: Key | None  # what is named in its place or said to be as likely, at sizes somewhat below `alone`


def promised_sizes(base: Calibration, check: Dataset, keys: Sequence[Key]) -> tuple[PromisedSize, ...]:
    """Sizes of changes that a check will find and name, each beside all rivals; the scanner stands where it stood.

    Args:
        base: the earlier calibration.
        check: check poses with points as predicted; their errors do not count.
        keys: `ChangeModel.key` of the changes asked about.
    """
    cell = CellTests.of(base, check, scanner_moved=False)
    judge = _Judge.of(cell, np.random.default_rng(0))
    by_key = {model.key: model for model in cell.models}
    return tuple(_promised(judge, by_key[key]) for key in keys if key in by_key)


def _promised(judge: _Judge, model: ChangeModel) -> PromisedSize:
    worst = [judge.least_size(_Along(judge, model, each).found) for each in _directions(judge.cell.free.rows(model))]
    known = [size for size in worst if size is not None]
    if len(known) < len(worst):
        return PromisedSize(model, None, None, None, None)
    found = max(known)
    by = _Along(judge, model, _drawn(model.count))
    named = judge.least_size(by.named, min(known))
    alone = judge.least_size(by.alone, named)
    at = 2.0 * found if alone is None else _SOMEWHAT_BELOW * alone
    return PromisedSize(model, found, named, alone, judge.rival(model, at * by.direction))


@dataclass(frozen=True)
class _Along:
    """Verdicts (D,) by the size of a change in one direction (K,), or in one of each draw (D, K)."""

    judge: _Judge
    model: ChangeModel
    direction: Array

    def found(self, size: float) -> BoolArray:
        return self.judge.alarms(self.model, size * self.direction)

    def named(self, size: float) -> BoolArray:
        return self.judge.names(self.model, size * self.direction).named

    def alone(self, size: float) -> BoolArray:
        return self.judge.names(self.model, size * self.direction).alone


def _directions(columns: Array) -> Iterator[Array]:
    """Unit vectors (K,) of a change of K numbers: one where K is 1, else its axes and what shows most and least."""
    count = columns.shape[1]
    yield from np.linalg.svd(columns, full_matrices=False)[2]
    yield from np.eye(count) if count > 1 else ()


def _drawn(count: int) -> Array:
    """Unit vectors (D, K) in directions drawn at random, one a draw."""
    drawn = np.random.default_rng(1).normal(size=(_DRAWS, count))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


@dataclass(frozen=True)
class _Levels:
    """Tests of one kind at once: bases side by side, and the weighted p-values that pass levels over all of them."""

    tests: tuple[ChangeTest[ChangeModel], ...]
    basis: Array  # (3 M, sum K)
    starts: IndexArray  # (T,) first column of each test
    counts: Array  # (T,) K of each
    noise_dof: float

    @classmethod
    def of(cls, tests: Sequence[ChangeTest[ChangeModel]], noise_dof: float) -> _Levels:
        counts = np.array([test.basis.shape[1] for test in tests])
        basis = np.concatenate([test.basis for test in tests], axis=1)
        return cls(tuple(tests), basis, np.cumsum([0, *counts[:-1]]), counts, min(noise_dof, 1e9))

    def gains(self, y: Array) -> Array:
        """Chi squared (D, T) that each test's change explains of residuals (D, 3 M)."""
        return np.add.reduceat((y @ self.basis) ** 2, self.starts, axis=1)

    def limits(self, family_wise: float) -> Array:
        """Gains (T,) from which a single test makes the family-wise p-value pass a level."""
        bases = [test.basis for test in self.tests]
        weights = np.array([weight(test.model) for test in self.tests])
        low, high = np.log(family_wise / weights.sum()), np.log(family_wise)
        for _ in range(12):
            middle = 0.5 * (low + high)
            passes = family_wise_p_value(bases, weights.tolist(), float(np.exp(middle)), self.noise_dof) <= family_wise
            low, high = (middle, high) if passes else (low, middle)
        return self.single(np.exp(low) * weights)

    def single(self, p_values: float | Array) -> Array:
        """Gains (T,) from which each test by itself has a p-value below the given one."""
        level = np.minimum(p_values, 1.0)
        return self.counts * special.fdtri(self.counts, self.noise_dof, 1.0 - level)


@dataclass(frozen=True)
class _Named:
    """Verdicts of D checks on a cell in which one change took place."""

    named: BoolArray  # (D,) whether it is named, and no other change
    rivals: BoolArray  # (D, T) changes that are named in its place, or said to be as likely

    @property
    def alone(self) -> BoolArray:
        """Mask (D,): whether it is named, and nothing is said to be as likely."""
        return self.named & ~self.rivals.any(axis=1)


@dataclass(frozen=True)
class _Judge:
    """Verdicts of `watch` on drawn residuals of one check."""

    cell: CellTests
    coloured: Array  # (D, 3 M) residuals of an unchanged cell, before they are whitened
    fixed: _Levels
    free: _Levels
    alarm: Array  # gains from which the whole is an alarm: of `fixed`, or of `free` where the scanner is set up anew
    named: Array  # of `free`: of a change that explains everything alone, and of one that does not
    named_given_others: Array
    seen: Array  # of `free`: from which a test counts as a rival

    @classmethod
    def of(cls, cell: CellTests, rng: np.random.Generator) -> _Judge:
        free = _Levels.of(cell.free.tests(cell.models), cell.free.noise_dof)
        fixed = _Levels.of(cell.fixed.tests(cell.models_with_scanner), cell.fixed.noise_dof)
        dof = fixed.noise_dof
        normal = rng.standard_normal((_DRAWS, len(cell.fixed.y)))
        normal /= np.sqrt(rng.chisquare(dof, _DRAWS) / dof)[:, None]  # the noise is known from a fit of so many
        known = cell.scanner_known
        return cls(
            cell,
            cell.fixed.spread.colour(normal.T).T,
            fixed,
            free,
            alarm=fixed.limits(ALARM) if known else free.limits(ALARM),
            named=free.limits(NAMED if known else ALARM),
            named_given_others=free.limits(NAMED_GIVEN_OTHERS if known else ALARM),
            seen=free.single(ALARM),
        )

    def _whitened(self, tests: ChangeTests, model: ChangeModel, vector: Array) -> Array:
        """Whitened residuals (D, 3 M) of a cell that changed by a vector (K,) or (D, K)."""
        return tests.spread.whiten(self.coloured.T).T + vector @ tests.rows(model).T

    def alarms(self, model: ChangeModel, vector: Array) -> BoolArray:
        """Mask (D,): whether each check would alarm."""
        known = self.cell.scanner_known
        y = self._whitened(self.cell.fixed if known else self.cell.free, model, vector)
        return np.asarray(((self.fixed if known else self.free).gains(y) >= self.alarm).any(axis=1))

    def names(self, model: ChangeModel, vector: Array) -> _Named:
        """Verdict of each check on a cell that changed by a vector (K,)."""
        tests = self.free.tests
        own = next((k for k, test in enumerate(tests) if test.model.key == model.key), None)
        if own is None:
            nothing = np.zeros((len(self.coloured), len(tests)), dtype=bool)
            return _Named(nothing[:, 0], nothing)
        gains = self.free.gains(self._whitened(self.cell.free, model, vector))
        parameters = np.array([test.model.count for test in tests])
        prior = np.array([2.0 * np.log(weight(test.model)) for test in tests])
        best = np.argmax(gains - PER_PARAMETER * parameters + prior, axis=1)
        explains = self._explains_alone(model, vector)[:, None]
        sure = (gains >= np.where(explains, self.named, self.named_given_others)).any(axis=1)
        fewer = parameters[own] - parameters
        rivals = (gains > gains[:, [own]] - CONFOUNDED - PER_PARAMETER * fewer) & (fewer >= 0) & (gains >= self.seen)
        rivals[np.arange(len(best)), best] = True
        rivals[:, own] = False
        return _Named((best == own) & sure & self.alarms(model, vector), rivals)

    def _explains_alone(self, model: ChangeModel, vector: Array) -> BoolArray:
        """Mask (D,): whether the change leaves no significant motion of the scanner."""
        if not self.cell.scanner_known:
            return np.zeros(len(self.coloured), dtype=bool)
        motion = self.cell.fixed.tests((self.cell.scanner,), given=[model])
        if not motion:
            return np.ones(len(self.coloured), dtype=bool)
        levels = _Levels.of(motion, self.cell.fixed.noise_dof)
        y = self._whitened(self.cell.fixed, model, vector)
        return (levels.gains(y) < levels.single(ALONE))[:, 0]

    def least_size(self, judged: Callable[[float], BoolArray], least: float | None = _NONE) -> float | None:
        """Least size at which `PROMISED` of the draws are judged well; None where none is large enough.

        least: a size below which it cannot be; None: there is none at all.
        """
        if least is None:
            return None
        low, high, factor, most = least, least, 2.0, _LARGEST * least
        if least == _NONE:
            factor, most = 8.0, _VAST
        while np.mean(judged(high)) < PROMISED:
            low, high = high, high * factor
            if high > most:
                return None
        while high > _PRECISION * low and high > least:
            middle = float(np.sqrt(low * high))
            low, high = (low, middle) if np.mean(judged(middle)) >= PROMISED else (middle, high)
        return high

    def rival(self, model: ChangeModel, vector: Array) -> Key | None:
        """What is named in this change's place, or said to be as likely, most often; the scanner where nothing else."""
        judged = self.names(model, vector)
        times = judged.rivals.sum(axis=0)
        if self.cell.scanner_known and np.mean(judged.named | judged.rivals.any(axis=1)) < 0.5:
            return SCANNER, None, ""  # too small a share is seen with the scanner's frame free
        return self.free.tests[int(np.argmax(times))].model.key if times.any() else None
