"""Drifts and steps over a series of checks of one cell, and the time until a tolerance is reached.

The errors of all checks are tested together. They share the earlier fit's errors, which therefore cancel in what
changes from check to check, so that a slow wear is found that no single check shows. Possible courses are a drift since
the calibration, and a step before any of the checks; where the scanner is free, its frame is free in each check.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np

from calib.api.fits import as_calibration
from calib.array_types import Array
from calib.calibration.result import FittedResult
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.errors import CalibError
from calib.extras.watch.change_models import SCANNER
from calib.extras.watch.change_tests import ALARM, USUAL
from calib.extras.watch.check_points import CheckPoints, Expectation
from calib.extras.watch.control_chart import date_of
from calib.extras.watch.courses import DRIFT, CourseSearch, TimedModel, stacked
from calib.measurement.measured_dataset import measured
from calib.presented import Presented
from calib.statistics import rms
from calib.validation.cell_changes import Change

FEWEST_CHECKS = 3
EWMA_WEIGHT = 0.3  # of the latest check in the moving average
_DRAWS = 10_000  # of an unchanged cell, for the limit of the moving averages
_DAY_S = 86400.0
_Z_95 = 1.645  # one-sided; of both sides 90 %


@dataclass(frozen=True)
class MovingAverage:
    """Exponentially weighted moving average of one change's size over the checks, in its own sigmas (EWMA)."""

    what: str
    joint: int | None
    unit: str
    sizes: Array  # (S,) of each check
    sigmas: Array  # (S,) of `sizes`, by the noise and the earlier fit
    smoothed: Array  # (S,) the moving average of `sizes`
    smoothed_sigmas: Array  # (S,)

    @property
    def z(self) -> Array:
        """Moving average (S,) over its sigma."""
        return self.smoothed / self.smoothed_sigmas


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
    """Report on a series of checks: the drift or step that they show together, and when it could be seen."""

    names: tuple[str, ...]  # of the checks, in order of time
    when: tuple[str, ...]  # `[about] date` of each, or ""
    times: Array  # (S,) since the calibration
    time_unit: str  # "day", or "check" where dates are missing
    calibration_dated: bool
    course: str  # DRIFT, STEP; "" where nothing changed
    change: Change | None  # the size of a drift is per unit of time
    onset: int  # index of the first check with the step
    either_course: bool  # whether drift and step are not told apart
    p_unchanged: float
    alarmed: int | None  # index of the check since which the series, up to it, raises an alarm
    named: int | None  # index of the check since which the same part is named
    averages: tuple[MovingAverage, ...]
    limit_z: float  # of all moving averages together: 1 of 200 unchanged series exceeds it
    time_left: TimeLeft | None

    @property
    def beyond_limit(self) -> tuple[MovingAverage, ...]:
        """Moving averages that are beyond the limit at the last check."""
        return tuple(average for average in self.averages if abs(average.z[-1]) > self.limit_z)

    @property
    def shown(self) -> MovingAverage | None:
        """Moving average that a chart shows: of the part that changed, else the one farthest from zero."""
        own = [] if self.change is None else [a for a in self.averages if self._is_of_change(a)]
        return max(own or self.averages, key=lambda average: abs(float(average.z[-1])), default=None)

    def _is_of_change(self, average: MovingAverage) -> bool:
        change = self.change
        return change is not None and average.joint == change.joint and average.what.startswith(change.what)

    @property
    def is_steady(self) -> bool:
        """Whether nothing drifts or steps, and no moving average is beyond the limit."""
        return self.change is None and not self.beyond_limit

    def _brief(self) -> str:
        return f"{len(self.names)} checks: {self.course or 'steady'}, p {self.p_unchanged:.2g} that nothing changed"


def watch_series(
    base: FittedResult | Dataset | str | Path,
    checks: Sequence[Dataset | str | Path],
    *,
    scanner_moved: bool = False,
    tolerance_mm: float | None = None,
) -> SeriesReport:
    """Report on what three or more checks of a cell show together: a drift or a step, and the time left.

    Args:
        base: the earlier calibration or diagnosis, or a dataset or its folder, which is then calibrated.
        checks: the check poses of each date; by `[about] date` where all have one, else in the order given.
        scanner_moved: whether the scanner was set up anew for each check, which is then no change.
        tolerance_mm: 3D error at the check poses that must not be reached.

    Raises:
        CalibError: fewer than three checks, or several stations of the scanner.
        FitError: fewer than three poses in a check.
    """
    base, new = as_calibration(base), [measured(as_dataset(check)) for check in checks]
    if len(new) < FEWEST_CHECKS:
        raise CalibError(f"found {len(new)} checks; a series takes {FEWEST_CHECKS} or more")
    dates = [date_of(dataset.about.date) for dataset in new]
    dated = [date for date in dates if date is not None]
    if len(dated) == len(new):
        new = [dataset for _, dataset in sorted(zip(dated, new, strict=True), key=lambda one: one[0])]
    times, unit, calibration_dated = _times(date_of(base.dataset.about.date), sorted(dated), len(new))
    points = [CheckPoints.of(base, dataset) for dataset in new]
    stations = {check.station for check in points}
    if len(stations) > 1:
        raise CalibError(f"the checks have several stations of the scanner ({', '.join(sorted(stations))})")
    expected = Expectation.of(base, points, scanner_moved=scanner_moved)

    @cache
    def up_to(count: int) -> CourseSearch:
        return CourseSearch.of(points[:count], times[:count], expected)

    now = up_to(len(points))
    best, p_unchanged = now.most_likely(), now.p_unchanged
    change = None if best is None else now.estimate(best)
    model = None if best is None else best.model

    def names_it(count: int) -> bool:
        found = up_to(count).most_likely()
        return found is not None and model is not None and found.model.key == model.key

    averages, limit_z = _moving_averages(now)
    return SeriesReport(
        names=tuple(dataset.name for dataset in new),
        when=tuple(dataset.about.date for dataset in new),
        times=times,
        time_unit=unit,
        calibration_dated=calibration_dated,
        course="" if model is None else model.course,
        change=change,
        onset=0 if model is None else model.onset,
        either_course=best is not None and now.has_other_course(best),
        p_unchanged=p_unchanged,
        alarmed=_since(len(points), lambda count: up_to(count).p_unchanged < ALARM),
        named=_since(len(points), names_it),
        averages=averages,
        limit_z=limit_z,
        time_left=None if tolerance_mm is None else _time_left(now, model, change, tolerance_mm),
    )


# ---- time -----------------------------------------------------------------------------------------------------------


def _times(calibrated: datetime | None, dated: list[datetime], count: int) -> tuple[Array, str, bool]:
    """Times (S,) of the checks since the calibration, their unit, and whether the calibration has a date.

    A calibration without a date, or with a later one, counts as made one mean interval before the first check.
    """
    if len(dated) < count or dated[0] == dated[-1]:
        return np.arange(1.0, count + 1.0), "check", False
    days = np.array([(date - dated[0]).total_seconds() / _DAY_S for date in dated])
    if calibrated is None or calibrated > dated[0]:
        return days + days[-1] / (count - 1), "day", False
    return days + (dated[0] - calibrated).total_seconds() / _DAY_S, "day", True


def _since(count: int, holds: Callable[[int], bool]) -> int | None:
    """Index of the check from which on a series up to each check `holds` to the end; None where it never does.

    `holds` takes the number of checks of such a series.
    """
    since = None
    for k in range(count, 0, -1):
        if not holds(k):
            break
        since = k - 1
    return since


# ---- the chart ------------------------------------------------------------------------------------------------------


def _moving_averages(search: CourseSearch) -> tuple[tuple[MovingAverage, ...], float]:
    """Moving averages of the size of each joint's zero and of each axis of the tool, and the limit for all of them.

    The limit comes from draws of unchanged cells, whose checks share the errors of the earlier fit.
    """
    count = len(search.times)
    tests = search.tests
    weights = EWMA_WEIGHT * (1.0 - EWMA_WEIGHT) ** np.subtract.outer(np.arange(count), np.arange(count)).clip(0)
    weights = np.tril(weights)
    averages, maps = [], []
    for model in stacked([check.models for check in search.checks]):
        if model.what not in USUAL:
            continue
        for axis in range(model.count):
            own = np.zeros((len(tests.y), count))
            for k in range(count):
                columns = np.where(search.row == k, 1.0, 0.0)[:, None, None] * model.columns[..., axis : axis + 1]
                own[:, k] = tests.rows(replace(model, columns=columns))[:, 0]
            shown = np.linalg.norm(own, axis=0) > 1e-9 * max(float(np.linalg.norm(own)), 1e-300)
            if not shown.all():
                continue
            inverse = np.linalg.pinv(own, rcond=1e-9)
            sizes, covariance = inverse @ tests.y, inverse @ inverse.T
            smooth = weights @ inverse
            smoothed_sigmas = np.linalg.norm(smooth, axis=1)
            maps.append(smooth / smoothed_sigmas[:, None])
            what = model.what if model.count == 1 else f"{model.what}_{'xyz'[axis]}"
            sigmas, smoothed = np.sqrt(np.diag(covariance)), smooth @ tests.y
            averages.append(MovingAverage(what, model.joint, model.unit, sizes, sigmas, smoothed, smoothed_sigmas))
    if not maps:
        return (), np.inf
    joint = np.concatenate(maps)
    root = np.asarray(np.linalg.qr(joint.T, mode="r")).T  # the averages are few, however many points there are
    rng = np.random.default_rng(0)
    drawn = np.abs(root @ rng.standard_normal((root.shape[1], _DRAWS)))
    dof = min(tests.noise_dof, 1e9)
    largest = drawn.max(axis=0) / np.sqrt(rng.chisquare(dof, _DRAWS) / dof)
    return tuple(averages), float(np.quantile(largest, 1.0 - ALARM))


# ---- the tolerance --------------------------------------------------------------------------------------------------


def _time_left(search: CourseSearch, model: TimedModel | None, change: Change | None, tolerance_mm: float) -> TimeLeft:
    """Time until change and promise together reach a tolerance, by the drift found, or by the fastest not excluded."""
    now = float(search.times[-1])
    spread = search.fixed.spread
    promised_mm = 0.0
    known = search.expected.before_T_base is not None
    if known:
        shared = spread.coloured(np.concatenate([np.linalg.inv(check.whiten) for check in search.checks])).shared_mm
        promised_mm = float(np.sqrt(np.sum(shared**2) / len(search.row)))

    def reached(rate_mm: float) -> float | None:
        """Time from now at which a change of the points by `rate_mm` per unit of time reaches the tolerance."""
        left_mm = float(np.sqrt(max(tolerance_mm**2 - promised_mm**2, 0.0)))
        return None if rate_mm <= 0.0 else max(left_mm / rate_mm - now, 0.0)

    if model is None or change is None or model.course != DRIFT or model.what == SCANNER:
        stepped_mm = 0.0
        if model is not None and change is not None and model.what != SCANNER:
            stepped_mm = model.moves_mm(np.array(change.vector or (change.size,)))
        fastest_mm = max([0.0, *(_fastest_mm(search, timed) for timed in search.models if timed.course == DRIFT)])
        error_mm = float(np.hypot(promised_mm, stepped_mm))
        earliest = 0.0 if error_mm >= tolerance_mm else reached(fastest_mm)
        return TimeLeft(tolerance_mm, error_mm, None, earliest, None)
    moved = model.moves_mm(np.array(change.vector or (change.size,)))
    per_time_mm = moved / rms(search.times[search.row])
    relative = change.sigma / abs(change.size)
    fast, slow = (per_time_mm * (1.0 + sign * _Z_95 * relative) for sign in (1.0, -1.0))
    error_mm = float(np.hypot(promised_mm, per_time_mm * now))
    return TimeLeft(tolerance_mm, error_mm, reached(per_time_mm), reached(fast), reached(slow))


def _fastest_mm(search: CourseSearch, model: TimedModel) -> float:
    """Fastest motion of the points per unit of time by a drift that the checks do not exclude at 95 %; 0: not shown."""
    tests = search.tests
    if model.what not in USUAL or not tests.tests((model,)):
        return 0.0
    change = tests.estimate(model, [model])
    vector = np.array(change.vector or (change.size,))
    size = float(np.linalg.norm(vector))
    along: Array = vector / size if size > 0.0 else np.eye(len(vector))[0]
    moved = model.moves_mm(along * (size + _Z_95 * change.sigma))
    return moved / rms(search.times[search.row])
