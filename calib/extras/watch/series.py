"""Drifts and steps over a series of checks of one cell, and the time until a tolerance is reached.

The errors of all checks are tested together. They share the earlier fit's errors, which therefore cancel in what
changes from check to check, so that a slow wear is found that no single check shows. Possible courses are a drift since
the calibration, and a step before any of the checks; where the scanner is free, its frame is free in each check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from calib.array_types import Array, IndexArray
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.watch.change_models import LARGEST_BY_UNIT, SCANNER, ChangeModel, change_label
from calib.extras.watch.change_tests import ALARM, ALONE, CONFOUNDED, NAMED, USUAL, ChangeTest, ChangeTests
from calib.extras.watch.check_points import CheckPoints, Expectation
from calib.extras.watch.watch import ChangeReport, report_of
from calib.presented import Presented
from calib.screening.blunders import without_blunders
from calib.statistics import rms
from calib.validation.cell_changes import Change

FEWEST_CHECKS = 3
DRIFT, STEP = "drift", "step"
_DAY_S = 86400.0
_Z_95 = 1.645  # one-sided; of both sides 90 %


@dataclass(frozen=True)
class TimeLeft:
    """Time until the 3D error at the check poses reaches a tolerance, from the last check on; None: not in sight."""

    tolerance_mm: float
    now_mm: float  # RMS, 3D, of change and promise, without noise
    likely: float | None
    earliest: float | None  # 90 % interval
    latest: float | None


@dataclass(frozen=True)
class SeriesReport(Presented):
    """Report on a series of checks: the drift or step that they show together."""

    names: tuple[str, ...]  # of the checks, in order of time
    dates: tuple[str, ...]  # `[about] date` of each, or ""
    times: Array  # (S,) since the calibration
    time_unit: str  # "day", or "check" where dates are missing
    calibration_dated: bool
    course: str  # DRIFT, STEP; "" where nothing changed
    change: Change | None  # the size of a drift is per unit of time
    onset: str | None  # name of the first check with a step
    p_unchanged: float
    time_left: TimeLeft | None

    @property
    def is_steady(self) -> bool:
        """Whether nothing drifts or steps."""
        return self.p_unchanged > ALARM

    def _brief(self) -> str:
        return f"{len(self.names)} checks: {self.course or 'steady'}, p {self.p_unchanged:.2g} that nothing changed"


def date_of(text: str) -> datetime | None:
    """Date and time (UTC, without zone) of an `[about] date`; None where it is missing or no date."""
    try:
        date = datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    return date if date.tzinfo is None else (date - (date.utcoffset() or date - date)).replace(tzinfo=None)


def watch_series(
    base: Calibration,
    checks: Sequence[Dataset],
    *,
    scanner_moved: bool = False,
    tolerance_mm: float | None = None,
) -> SeriesReport:
    """Report on what three or more checks of a cell, from one station of the scanner, show together.

    Args:
        base: the earlier calibration.
        checks: the measured check poses of each date, in order of time.
        scanner_moved: whether the scanner was set up anew for each check, which is then no change.
        tolerance_mm: 3D error at the check poses that must not be reached.

    Raises FitError for fewer than three poses in a check.
    """
    times, unit, calibration_dated = _times(base, checks)
    points = [CheckPoints.of(base, dataset) for dataset in checks]
    search = CourseSearch.of(points, times, Expectation.of(base, points, scanner_moved=scanner_moved))
    model, change = search.likeliest() or (None, None)
    return SeriesReport(
        names=tuple(dataset.name for dataset in checks),
        dates=tuple(dataset.about.date for dataset in checks),
        times=times,
        time_unit=unit,
        calibration_dated=calibration_dated,
        course="" if model is None else model.course,
        change=change,
        onset=checks[model.onset].name if model is not None and model.course == STEP else None,
        p_unchanged=search.p_unchanged,
        time_left=None if tolerance_mm is None else _time_left(search, model, change, tolerance_mm),
    )


def _times(base: Calibration, checks: Sequence[Dataset]) -> tuple[Array, str, bool]:
    """Times (S,) of the checks since the calibration, their unit, and whether the calibration has a date.

    A calibration without a date, or with a later one, counts as made one mean interval before the first check.
    """
    calibrated = date_of(base.dataset.about.date)
    dates = [date for check in checks if (date := date_of(check.about.date)) is not None]
    if len(dates) < len(checks) or dates[0] == dates[-1]:
        return np.arange(1.0, len(checks) + 1.0), "check", False
    days = np.array([(date - dates[0]).total_seconds() / _DAY_S for date in dates])
    if calibrated is None or calibrated > dates[0]:
        return days + days[-1] / (len(checks) - 1), "day", False
    return days + (dates[0] - calibrated).total_seconds() / _DAY_S, "day", True


# ---- the search -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class TimedModel(ChangeModel):
    """Model of a change of a cell with its course over a series of checks."""

    course: str  # DRIFT, STEP
    onset: int  # index of the first check with the step; 0 for a drift
    places: int  # number of onsets that are tried for this course


@dataclass(frozen=True)
class CourseSearch:
    """Tests of all courses of all changes by the checks of a series."""

    times: Array  # (S,)
    row: IndexArray  # (M,) index of each point's check
    fixed: ChangeTests
    free: ChangeTests
    scanner: tuple[TimedModel, ...]  # of the scanner; none where its earlier station is unknown
    of_arm: tuple[ChangeTest[TimedModel], ...]  # with the scanner's frame free in each check
    of_all: tuple[ChangeTest[TimedModel], ...]  # with the scanner where it was; where that is unknown, `of_arm`
    p_unchanged: float  # family-wise, of the most significant of `of_all`
    promised_mm: float  # RMS, 3D, by the uncertainty of the earlier fit; 0 where its station is unknown

    @classmethod
    def of(cls, checks: Sequence[CheckPoints], times: Array, expected: Expectation) -> CourseSearch:
        """Tests of a series, each change with each of its courses."""
        fixed, free = expected.tests(checks)
        row = np.repeat(np.arange(len(checks)), [len(check.at_mm) for check in checks])
        models = _timed([check.models for check in checks], times, row)
        of_arm = tuple(free.tests(models))
        before = expected.before_T_base
        if before is None:
            return cls(times, row, fixed, free, (), of_arm, of_arm, free.family_wise_p_value(of_arm), 0.0)
        moved = _timed([(c.scanner_motion(before, expected.prior.centre_mm),) for c in checks], times, row)
        of_all = tuple(fixed.tests((*models, *moved)))
        promised_mm = fixed.spread.shared_mm(np.concatenate([check.colour for check in checks]))
        p_unchanged = fixed.family_wise_p_value(of_all)
        return cls(times, row, fixed, free, tuple(moved), of_arm, of_all, p_unchanged, promised_mm)

    def likeliest(self) -> tuple[TimedModel, Change] | None:
        """Most likely change with its course and size, and its rivals; of the arm if no moved scanner explains it."""
        if self.p_unchanged > ALARM:
            return None
        p_arm = self.free.family_wise_p_value(self.of_arm)
        for tests, p_value in ((self.of_arm, p_arm), (self.of_all, self.p_unchanged))[p_arm >= NAMED :]:
            best = max(tests, key=_score, default=None)
            change = None if best is None else self._estimate(best)
            if best is None or change is None:
                continue
            rivals = (
                change_label(*test.model.key)
                for test in tests
                if test.model.key != best.model.key
                and _score(test) > _score(best) - CONFOUNDED
                and test.p_value < ALARM
            )
            return best.model, replace(change, p_value=p_value, as_well=tuple(dict.fromkeys(rivals)))
        return None

    def _estimate(self, test: ChangeTest[TimedModel]) -> Change | None:
        """Size of a change; None for one that, at the last check, no part can have."""
        alone = next(iter(self.fixed.tests(self.scanner, given=[test.model])), None)
        at_rest = bool(self.scanner) and (alone is None or alone.p_value > ALONE)
        tests = self.fixed if at_rest or test.model.what == SCANNER else self.free
        change = tests.estimate(test.model, [test.model])
        largest = abs(change.size) * (self.times[-1] if test.model.course == DRIFT else 1.0)
        return change if largest <= LARGEST_BY_UNIT[change.unit] else None


def _score(test: ChangeTest[TimedModel]) -> float:
    """Twice the log odds of a change with its course, each onset of a step being as likely, up to a constant."""
    return test.score - 2.0 * float(np.log(test.model.places))


def _timed(of_checks: Sequence[Sequence[ChangeModel]], times: Array, row: IndexArray) -> list[TimedModel]:
    """Changes that all checks have, by all points, with their courses: a drift; usual ones with a step before each."""
    count, timed = len(times), []
    steps = [(STEP, k, (np.arange(count) >= k).astype(float), count) for k in range(count)]
    for model in of_checks[0]:
        same = [other for models in of_checks for other in models if other.key == model.key]
        if len(same) == count:
            columns = np.concatenate([one.columns for one in same])
            for course, onset, factor, places in ((DRIFT, 0, times, 1), *(steps if model.what in USUAL else ())):
                moved = columns * factor[row][:, None, None]
                timed.append(TimedModel(*model.key, model.unit, moved, course, onset, places))
    return timed


# ---- the tolerance --------------------------------------------------------------------------------------------------


def _time_left(search: CourseSearch, model: TimedModel | None, change: Change | None, tolerance_mm: float) -> TimeLeft:
    """Time until the drift that was found and the promise together reach a tolerance."""
    promised_mm = search.promised_mm
    if model is None or change is None or model.what == SCANNER:
        return TimeLeft(tolerance_mm, promised_mm, None, None, None)
    moved_mm = model.moves_mm(np.array(change.vector or (change.size,)))
    if model.course != DRIFT:
        return TimeLeft(tolerance_mm, float(np.hypot(promised_mm, moved_mm)), None, None, None)
    now, per_time_mm = float(search.times[-1]), moved_mm / rms(search.times[search.row])
    left_mm = float(np.sqrt(max(tolerance_mm**2 - promised_mm**2, 0.0)))
    rates_mm = (per_time_mm * (1.0 + sigmas * change.sigma / abs(change.size)) for sigmas in (0.0, _Z_95, -_Z_95))
    reached = [None if rate_mm <= 0.0 else max(left_mm / rate_mm - now, 0.0) for rate_mm in rates_mm]
    return TimeLeft(tolerance_mm, float(np.hypot(promised_mm, per_time_mm * now)), *reached)


# ---- the cell -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WatchedCell:
    """Change reports of later measurements, with what all show together."""

    seen: tuple[ChangeReport, ...]  # by date where all have one, else in the order given
    together: SeriesReport | None  # None for fewer than three checks whose tables are right

    @property
    def is_unchanged(self) -> bool:
        """Whether neither a check by itself nor the series shows a change."""
        steady = self.together is None or self.together.is_steady
        return steady and all(report.verdict == "unchanged" for report in self.seen)


def watched_cell(
    base: Calibration, later: Sequence[Dataset], *, scanner_moved: bool = False, tolerance_mm: float | None = None
) -> WatchedCell:
    """Change reports of later measurements against a calibration, and what they show together.

    Raises:
        FitError: as `watch` does.
        CalibError: a tolerance for fewer than three checks whose tables are right.
    """
    base, dates = without_blunders(base), [date_of(dataset.about.date) for dataset in later]
    if None not in dates:
        later = [later[k] for k in sorted(range(len(later)), key=lambda k: str(dates[k]))]
    seen = tuple(report_of(base, dataset, scanner_moved=scanner_moved) for dataset in later)
    right = [dataset for dataset, report in zip(later, seen, strict=True) if report.data_problem is None]
    if len(right) >= FEWEST_CHECKS and len({str(dataset.poses.setup[0]) for dataset in right}) == 1:
        return WatchedCell(seen, watch_series(base, right, scanner_moved=scanner_moved, tolerance_mm=tolerance_mm))
    if tolerance_mm is not None:
        raise CalibError(
            f"the time until a tolerance is reached takes {FEWEST_CHECKS} checks or more with one station of the "
            f"scanner; found {len(right)}"
        )
    return WatchedCell(seen, None)
