"""Drifts and steps over a series of checks, measured by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest

from calib import calibrate
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.watch.change_models import DRIFT, STEP
from calib.extras.watch.present.changes import series_sentence, time_left_sentence, watch_document, watch_summary
from calib.extras.watch.series import watch_series, watched_cell
from calib.extras.watch.watch import watch
from calib.statistics import rms_length
from tests.support.checked_cell import Cell

pytest.importorskip("mujoco")
CHECKS = 8


def dated(dataset: Dataset, day: int) -> Dataset:
    """The dataset as measured some days after the first of March."""
    return replace(dataset, about=replace(dataset.about, date=str(date(2026, 3, 1) + timedelta(days=day))))


def series(
    course: Callable[[Cell, int], Cell], seed: int = 5, robot: str = "rb5"
) -> tuple[Calibration, list[Dataset], Cell, Array]:
    """A calibration, eight daily checks of the cell as `course` has it, the first cell, and the check's joints."""
    rng = np.random.default_rng(seed)
    cell = Cell.drawn(rng, robot)
    base = calibrate(dated(cell.measured(rng, 64, "before"), 0))
    q = cell.measured(rng, 8).poses.q
    checks = [dated(course(cell, k).measured(rng, name=f"c{k}", q=q), k) for k in range(1, CHECKS + 1)]
    return base, checks, cell, q


def drifting(rate_deg: float) -> Callable[[Cell, int], Cell]:
    """Joint 3 drifts by that much a day."""
    return lambda cell, day: cell.with_changes({"theta3": np.radians(rate_deg) * day})


def test_a_drift_too_small_for_each_check_is_named_by_all() -> None:
    base, checks, cell, q = series(drifting(0.0015))
    found = watch_series(base, checks, tolerance_mm=0.4)
    assert found.change is not None
    assert (found.course, found.change.what, found.change.joint) == (DRIFT, "joint_zero", 3)
    assert found.change.size == pytest.approx(np.radians(0.0015), abs=3.0 * found.change.sigma)
    assert found.change.sigma < 0.2 * found.change.size
    assert watch(base, checks[2]).verdict == "unchanged"
    # The truth: the day on which the arm's own motion at the check poses reaches the tolerance.
    per_day_mm = rms_length(drifting(0.0015)(cell, 1).seen_mm(q) - cell.seen_mm(q))
    left = found.time_left
    assert left is not None
    assert left.earliest is not None
    assert left.latest is not None
    assert left.earliest < 0.4 / per_day_mm - CHECKS < left.latest + 3.0
    assert "drifts by" in series_sentence(found)
    assert "90 % interval" in time_left_sentence(found)


def test_a_step_is_told_from_a_drift_with_the_check_before_which_it_came() -> None:
    base, checks, *_ = series(lambda cell, day: cell.with_changes({"theta2": np.radians(0.02) * (day > 4)}))
    found = watch_series(base, checks)
    assert found.change is not None
    assert (found.course, found.change.joint, found.onset) == (STEP, 2, "c5")
    assert "between c4 (2026-03-05) and c5 (2026-03-06)" in series_sentence(found)


def test_an_unchanged_cell_is_steady() -> None:
    base, checks, *_ = series(lambda cell, _: cell)
    found = watched_cell(base, checks[::-1], tolerance_mm=0.4).together
    assert found is not None
    assert found.is_steady
    assert found.change is None
    assert found.names == tuple(f"c{k}" for k in range(1, CHECKS + 1))  # by date, whatever the order given
    left = found.time_left
    assert left is not None
    assert left.likely is None
    assert "nothing drifts or steps" in series_sentence(found)


def test_a_scanner_that_creeps_is_not_blamed_on_the_arm() -> None:
    base, checks, *_ = series(lambda cell, day: cell.with_scanner_moved(np.zeros(3), np.array([0.02, 0.0, 0.01]) * day))
    found = watch_series(base, checks)
    assert found.change is not None
    assert found.change.what == "scanner"
    assert found.course == DRIFT


def test_a_warm_arm_is_told_as_warm_and_not_as_one_length() -> None:
    def warmed(cell: Cell, _: int) -> Cell:
        names, table = cell.nominal.parameter_names, cell.nominal.table.ravel()
        units = cell.nominal.parameter_units
        return cell.with_changes({n: 4e-4 * v for n, v, u in zip(names, table, units, strict=True) if u == "mm"})

    base, checks, *_ = series(warmed)
    report = watch(base, checks[0])
    (change,) = report.changes
    assert change.what == "warmth"
    assert change.size == pytest.approx(400.0, abs=4.0 * change.sigma)
    assert "All lengths together grew by" in report.summary()


def test_a_grown_backlash_is_named_where_the_side_of_approach_is_known() -> None:
    rng = np.random.default_rng(8)
    cell = Cell.drawn(rng)

    def approached(dataset: Dataset, play_rad: float) -> Dataset:
        approach = rng.choice([-1.0, 1.0], size=dataset.poses.q.shape)
        turned = dataset.poses.q.copy()
        turned[:, 1] += 0.5 * play_rad * approach[:, 1]
        seen = cell.measured(rng, q=turned, name=dataset.name)
        return replace(
            seen, poses=replace(seen.poses, q=dataset.poses.q, approach=approach, came_from=np.zeros((0, 0)))
        )

    base = calibrate(approached(cell.measured(rng, 64, "before"), 0.0))
    report = watch(base, approached(cell.measured(rng, 16), np.radians(0.04)))
    (change,) = report.changes
    assert (change.what, change.joint) == ("backlash", 2)
    assert change.size == pytest.approx(np.radians(0.04), abs=4.0 * change.sigma)


def test_a_drift_is_sought_over_dates_alone() -> None:
    base, checks, *_ = series(drifting(0.003))
    undated = [replace(checks[0], about=replace(checks[0].about, date="")), *checks[1:]]
    cell = watched_cell(base, undated)
    assert (cell.together, cell.undated) == (None, ("c1",))
    assert "No drift is sought" in watch_summary(cell)[-1]
    with pytest.raises(CalibError, match=r"dataset c1: .* give it \[about\] date"):
        watched_cell(base, undated, tolerance_mm=0.4)
    late = replace(base, dataset=dated(base.dataset, 3))
    assert watched_cell(late, checks).undated == ("before",)


def test_too_few_checks_say_how_many_it_takes() -> None:
    base, checks, *_ = series(drifting(0.003))
    with pytest.raises(CalibError, match="takes 3 checks or more"):
        watched_cell(base, checks[:2], tolerance_mm=0.4)
    assert watched_cell(base, checks[:2]).together is None


def test_the_document_of_a_cell_has_the_series() -> None:
    base, checks, *_ = series(drifting(0.003))
    cell = watched_cell(base, checks, tolerance_mm=0.4)
    assert not cell.is_unchanged
    assert cell.together is not None
    document = cell.together.to_dict()
    assert document["change"]["joint"] == 3
    whole = watch_document(cell)
    assert whole["series"] is cell.together
    (trend,) = whole["trend"]
    assert (trend["what"], trend["joint"], trend["unit"]) == ("joint_zero", 3, "rad")
    assert trend["per_day"] == pytest.approx(np.radians(0.003), abs=3.0 * trend["sigma"])
    assert cell.together.time_left is not None
    assert trend["days_left"] == cell.together.time_left.likely
    assert "the tolerance of 0.40 mm" in cell.together.summary()
