"""Search for the one change of a cell over a series of checks: every part, with every course that it can take.

A change drifts since the calibration, or steps before one of the checks. The tests take the points of all checks
together; where the scanner is free, its frame is free in each check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.array_types import Array, IndexArray
from calib.extras.watch.cell import scanner_motion
from calib.extras.watch.change_models import LARGEST_BY_UNIT, SCANNER, ChangeModel, change_label
from calib.extras.watch.change_tests import ALARM, ALONE, CONFOUNDED, NAMED, USUAL, ChangeTest, ChangeTests
from calib.extras.watch.check_points import CheckPoints, Expectation
from calib.validation.cell_changes import Change

DRIFT, STEP = "drift", "step"


@dataclass(frozen=True)
class TimedModel(ChangeModel):
    """Model of a change of a cell with its course over a series of checks."""

    course: str  # DRIFT, STEP
    onset: int  # index of the first check with the step; 0 for a drift
    places: int  # number of onsets that are tried for this course


@dataclass(frozen=True)
class CourseSearch:
    """Tests of all courses of all changes by the checks of a series."""

    checks: Sequence[CheckPoints]
    times: Array  # (S,)
    row: IndexArray  # (M,) index of each point's check
    expected: Expectation
    fixed: ChangeTests
    free: ChangeTests
    models: tuple[TimedModel, ...]  # of the arm
    scanner: tuple[TimedModel, ...]  # of the scanner; none where its earlier station is unknown
    of_arm: tuple[ChangeTest[TimedModel], ...]  # with the scanner's frame free in each check
    of_all: tuple[ChangeTest[TimedModel], ...]  # with the scanner where it was; where that is unknown, `of_arm`

    @classmethod
    def of(cls, checks: Sequence[CheckPoints], times: Array, expected: Expectation) -> CourseSearch:
        """Tests of a series, each change with each of its courses."""
        fixed, free = expected.tests(checks)
        row = np.repeat(np.arange(len(checks)), [len(check.at_mm) for check in checks])
        models = tuple(t for m in stacked([check.models for check in checks]) for t in _timed(m, times, row))
        scanner: tuple[TimedModel, ...] = ()
        before = expected.before_T_base
        if before is not None:
            motions = [(scanner_motion(check, before, expected.prior.centre_mm),) for check in checks]
            scanner = tuple(t for m in stacked(motions) for t in _timed(m, times, row))
        of_arm = tuple(free.tests(models))
        of_all = tuple(fixed.tests((*models, *scanner))) if scanner else of_arm
        return cls(checks, times, row, expected, fixed, free, models, scanner, of_arm, of_all)

    @property
    def tests(self) -> ChangeTests:
        """Tests with the scanner where it was, or free where that is unknown."""
        return self.fixed if self.scanner else self.free

    @cached_property
    def p_unchanged(self) -> float:
        """Family-wise p-value of the most significant course of any change, where nothing changed."""
        return self.tests.family_wise_p_value(self.of_all)

    def most_likely(self) -> ChangeTest[TimedModel] | None:
        """Most likely change with its course; of the arm only where a moved scanner does not explain it; None: none."""
        if self.p_unchanged > ALARM:
            return None
        arm = _best(self.of_arm)
        if arm is not None and self.free.family_wise_p_value(self.of_arm) < NAMED and self._is_possible(arm):
            return arm
        best = _best(self.of_all)
        return best if best is not None and self._is_possible(best) else None

    def _is_possible(self, test: ChangeTest[TimedModel]) -> bool:
        """Whether a change's size, at the last check, is one that a part can have."""
        change = self._raw_estimate(test)
        largest = abs(change.size) * (self.times[-1] if test.model.course == DRIFT else 1.0)
        return bool(largest <= LARGEST_BY_UNIT[change.unit])

    def _raw_estimate(self, test: ChangeTest[TimedModel]) -> Change:
        alone = next(iter(self.fixed.tests(self.scanner, given=[test.model])), None)
        at_rest = bool(self.scanner) and (alone is None or alone.p_value > ALONE)
        tests = self.fixed if at_rest or test.model.what == SCANNER else self.free
        return tests.estimate(test.model, [test.model])

    def estimate(self, best: ChangeTest[TimedModel]) -> Change:
        """Size of the most likely change, with its rivals."""
        scanner_free = any(best is test for test in self.of_arm)
        tests = self.of_arm if scanner_free else self.of_all
        rivals = [
            change_label(*test.model.key)
            for test in tests
            if test.model.key != best.model.key and _score(test) > _score(best) - CONFOUNDED and test.p_value < ALARM
        ]
        p_value = (self.free if scanner_free else self.fixed).family_wise_p_value(tests)
        return replace(self._raw_estimate(best), p_value=p_value, as_well=tuple(dict.fromkeys(rivals)))

    def has_other_course(self, best: ChangeTest[TimedModel]) -> bool:
        """Whether the same part's other course explains about as much."""
        return any(
            test.model.course != best.model.course
            and test.model.key == best.model.key
            and _score(test) > _score(best) - CONFOUNDED
            for test in (*self.of_arm, *self.of_all)
        )


def _best(tests: Sequence[ChangeTest[TimedModel]]) -> ChangeTest[TimedModel] | None:
    return max(tests, key=_score, default=None)


def _score(test: ChangeTest[TimedModel]) -> float:
    """Twice the log odds of a change with its course, each onset of a step being as likely, up to a constant."""
    return test.score - 2.0 * float(np.log(test.model.places))


def stacked(of_checks: Sequence[Sequence[ChangeModel]]) -> list[ChangeModel]:
    """Change models of the points of all checks together; those that some check does not have are left out."""
    by_key = [{model.key: model for model in models} for models in of_checks]
    common = [model for model in of_checks[0] if all(model.key in models for models in by_key)]
    return [replace(m, columns=np.concatenate([models[m.key].columns for models in by_key])) for m in common]


def _timed(model: ChangeModel, times: Array, row: IndexArray) -> list[TimedModel]:
    """A change with each of its courses: a drift since the calibration; if it is usual, a step before each check."""

    def of(course: str, onset: int, factor: Array, places: int) -> TimedModel:
        columns = model.columns * factor[row][:, None, None]
        return TimedModel(model.what, model.joint, model.parameter, model.unit, columns, course, onset, places)

    steps = range(len(times)) if model.what in USUAL else ()
    return [
        of(DRIFT, 0, times, 1),
        *(of(STEP, k, (np.arange(len(times)) >= k).astype(float), len(times)) for k in steps),
    ]
