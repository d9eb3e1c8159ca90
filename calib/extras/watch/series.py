"""Drifts and steps over a series of checks of one cell, and the time until a tolerance is reached.

The errors of all checks are tested together. They share the earlier fit's errors, which therefore cancel in what
changes from check to check, so that a slow wear is found that no single check shows. Possible courses are a drift since
the calibration, and a step before any of the checks; where the scanner is free, its frame is free in each check.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.watch.cell import CellTests
from calib.extras.watch.change_models import DRIFT, LARGEST_BY_UNIT, SCANNER, STEP, Change, ChangeModel, change_label
from calib.extras.watch.change_tests import ALARM, ALONE, CONFOUNDED, NAMED, family_wise_p_value, most_likely
from calib.extras.watch.watch import ChangeReport, report_of
from calib.presented import Presented
from calib.screening.blunders import without_blunders
from calib.statistics import rms

FEWEST_CHECKS = 3
_DAY_S = 86400.0
_Z_95 = 1.645  # one-sided; of both sides 90 %


@dataclass(frozen=True)
class TimeLeft:
    """Time until the 3D error at the check poses reaches a tolerance, from the last check on; None: not in sight."""

    tolerance_mm: float
    now_mm: float  # RMS, 3D, of change and promise, without noise
    likely: float | None = None
    earliest: float | None = None  # 90 % interval
    latest: float | None = None


@dataclass(frozen=True)
class SeriesReport(Presented):
    """Report on a series of checks: the drift or step that they show together."""

    names: tuple[str, ...]  # of the checks, in order of time
    dates: tuple[str, ...]  # `[about] date` of each
    times: Array  # (S,) days since the calibration
    course: str  # DRIFT, STEP; "" where nothing changed
    change: Change | None  # the size of a drift is per day
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
    return date if date.tzinfo is None else date.astimezone(UTC).replace(tzinfo=None)


def watch_series(base: Calibration, checks: Sequence[Dataset], *, tolerance_mm: float | None = None) -> SeriesReport:
    """Report on what three or more checks of a cell, from one station of the scanner, show together.

    Args:
        base: the earlier calibration.
        checks: the measured check poses of each date, in order of time.
        tolerance_mm: 3D error at the check poses that must not be reached.

    Raises FitError for fewer than three poses in a check, CalibError where dates are missing.
    """
    if undated := without_date(base, checks):
        raise CalibError(f"dataset {undated[0]}: a drift is sought over dates; give it [about] date in dataset.toml")
    first, *dates = (date_of(each.about.date) for each in (base.dataset, *checks))
    times = np.array([(date - first).total_seconds() / _DAY_S for date in dates if date and first])
    tests = CellTests.of(base, checks, times)
    model, change = _likeliest(tests, times) or (None, None)
    return SeriesReport(
        names=tuple(dataset.name for dataset in checks),
        dates=tuple(dataset.about.date for dataset in checks),
        times=times,
        course="" if model is None else model.course,
        change=change,
        onset=checks[model.onset].name if model is not None and model.course == STEP else None,
        p_unchanged=tests.p_unchanged,
        time_left=None if tolerance_mm is None else _time_left(tests, times, model, change, tolerance_mm),
    )


def without_date(base: Calibration, checks: Sequence[Dataset]) -> tuple[str, ...]:
    """Names of datasets without an `[about] date`; of the calibration where its date is not the first."""
    every = (base.dataset, *checks)
    dates = [date_of(each.about.date) for each in every]
    undated = tuple(each.name for each, date in zip(every, dates, strict=True) if date is None)
    first, *rest = map(str, dates)
    return undated or ((every[0].name,) if first > min(rest) or first == max(rest) else ())


# ---- the search -----------------------------------------------------------------------------------------------------


def _likeliest(tests: CellTests, times: Array) -> tuple[ChangeModel, Change] | None:
    """Most likely change with its course and size, and its rivals; of the arm if no moved scanner explains it."""
    if tests.p_unchanged > ALARM:
        return None
    of_arm = tests.free.tests(tests.models)
    p_arm = family_wise_p_value(of_arm)
    of_all = tests.fixed.tests((*tests.models, *tests.scanner)) if tests.scanner_known else of_arm
    for each, p_value in ((of_arm, p_arm), (of_all, tests.p_unchanged))[p_arm >= NAMED :]:
        best = most_likely(each)
        change = None if best is None else _estimate(tests, times, best.model)
        if best is None or change is None:
            continue
        rivals = (
            change_label(*test.model.key)
            for test in each
            if test.model.key != best.model.key and test.score > best.score - CONFOUNDED and test.p_value < ALARM
        )
        return best.model, replace(change, p_value=p_value, as_well=tuple(dict.fromkeys(rivals)))
    return None


def _estimate(tests: CellTests, times: Array, model: ChangeModel) -> Change | None:
    """Size of a change; None for one that, at the last check, no part can have."""
    alone = next(iter(tests.fixed.tests(tests.scanner, given=[model])), None)
    at_rest = tests.scanner_known and (alone is None or alone.p_value > ALONE)
    change = (tests.fixed if at_rest or model.what == SCANNER else tests.free).estimate(model, [model])
    largest = abs(change.size) * (times[-1] if model.course == DRIFT else 1.0)
    return change if largest <= LARGEST_BY_UNIT[change.unit] else None


# ---- the tolerance --------------------------------------------------------------------------------------------------


def _time_left(
    tests: CellTests, times: Array, model: ChangeModel | None, change: Change | None, tolerance_mm: float
) -> TimeLeft:
    """Time until the drift that was found and the promise together reach a tolerance."""
    colour = np.concatenate([check.colour for check in tests.checks])
    promised_mm = tests.fixed.spread.shared_mm(colour) if tests.scanner_known else 0.0
    if model is None or change is None or model.what == SCANNER:
        return TimeLeft(tolerance_mm, promised_mm)
    moved_mm = model.moves_mm(np.array(change.vector or (change.size,)))
    if model.course != DRIFT:
        return TimeLeft(tolerance_mm, float(np.hypot(promised_mm, moved_mm)))
    per_time_mm = moved_mm / rms(np.repeat(times, [len(check.at_mm) for check in tests.checks]))
    left_mm = float(np.sqrt(max(tolerance_mm**2 - promised_mm**2, 0.0)))
    rates_mm = (per_time_mm * (1.0 + sigmas * change.sigma / abs(change.size)) for sigmas in (0.0, _Z_95, -_Z_95))
    reached = [None if rate_mm <= 0.0 else max(left_mm / rate_mm - times[-1], 0.0) for rate_mm in rates_mm]
    return TimeLeft(tolerance_mm, float(np.hypot(promised_mm, per_time_mm * times[-1])), *reached)


# ---- the cell -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WatchedCell:
    """Change reports of later measurements, with what all show together."""

    seen: tuple[ChangeReport, ...]  # by date where all have one, else in the order given
    together: SeriesReport | None  # None for fewer than three checks with dates whose tables are right
    undated: tuple[str, ...]  # datasets whose date a series of enough checks lacks

    @property
    def is_unchanged(self) -> bool:
        """Whether neither a check by itself nor the series shows a change."""
        steady = self.together is None or self.together.is_steady
        return steady and all(report.verdict == "unchanged" for report in self.seen)


def watched_cell(base: Calibration, later: Sequence[Dataset], *, tolerance_mm: float | None = None) -> WatchedCell:
    """Change reports of later measurements against a calibration, and what they show together.

    Raises:
        FitError: as `watch` does.
        CalibError: a tolerance for fewer than three checks whose tables are right, or without dates.
    """
    base, dates = without_blunders(base), [date_of(dataset.about.date) for dataset in later]
    if None not in dates:
        later = [later[k] for k in sorted(range(len(later)), key=lambda k: str(dates[k]))]
    seen = tuple(report_of(base, dataset) for dataset in later)
    right = [dataset for dataset, report in zip(later, seen, strict=True) if report.data_problem is None]
    is_series = len(right) >= FEWEST_CHECKS and len({str(dataset.poses.setup[0]) for dataset in right}) == 1
    undated = without_date(base, right) if is_series else ()
    if tolerance_mm is not None and not is_series:
        raise CalibError(
            f"the time until a tolerance is reached takes {FEWEST_CHECKS} checks or more with one station of the "
            f"scanner; found {len(right)}"
        )
    if not is_series or (undated and tolerance_mm is None):
        return WatchedCell(seen, None, undated)
    return WatchedCell(seen, watch_series(base, right, tolerance_mm=tolerance_mm), ())
