"""Changes of one arm from one dataset to the next, where a plug-in tests for changes (`watch` does)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.search_space import add_in_turn
from calib.errors import CalibError
from calib.extras.fleet.judge import Judged, key_of, one_line
from calib.extras.fleet.row import Row
from calib.plugins import contributions, load
from calib.validation.cell_changes import NOT_OF_THE_ARM, CellChanges, Change, ChangeTest


@dataclass(frozen=True)
class Drift:
    """Changes between two datasets of one arm: the later points against the earlier calibration."""

    base: str  # path
    later: str
    verdict: str = ""  # unchanged, changed, unclear; "" where they cannot be compared
    changes: tuple[Change, ...] = ()
    rmse_mm: float | None = None  # 3D error of the later points by the earlier calibration
    reason: str = ""  # why they cannot be compared, or what is wrong with the later poses.csv; one line

    @property
    def of_the_arm(self) -> bool:
        """Whether the arm itself changed, where the verdict is unambiguous."""
        return self.verdict == "changed" and any(c.what not in NOT_OF_THE_ARM for c in self.changes)


@dataclass(frozen=True)
class DriftTask:
    """Task of comparing two datasets of an arm, given by their paths and what was found in scans."""

    folder: str
    base: Judged
    later: Judged

    @property
    def key(self) -> str:
        """Hash of everything that determines the comparison."""
        return key_of({"base": self.base.key, "later": self.later.key})


def change_test() -> ChangeTest | None:
    """The test for changes that a plug-in brings; None without one, and then no datasets are compared."""
    return next(iter(contributions(ChangeTest)), None)


def consecutive(rows: Iterable[Row]) -> list[tuple[Row, Row]]:
    """Pairs of datasets of one arm: each dataset with the last fitted one of an earlier date.

    None where nothing tests for changes. Datasets without a serial number or a date are in no pair. A few check poses
    are too few for a fit and are compared with the last calibration before them.
    """
    dated = [row for row in rows if row.serial and row.date] if change_test() is not None else []
    out = []
    for _, of_arm in groupby(sorted(dated, key=lambda row: (row.arm, row.date, row.path)), lambda row: row.arm):
        of_arm_in_order = list(of_arm)
        for row in of_arm_in_order:
            fitted = [base for base in of_arm_in_order if base.verdict and base.date < row.date]
            out += [(base, row) for base in fitted[-1:]]
    return out


def compare(task: DriftTask) -> Drift:
    """Changes between two datasets of an arm, or the reason why they cannot be compared."""
    base, later = task.base.row, task.later.row
    test = change_test()
    assert test is not None  # or there was no pair to compare
    try:
        fits = add_in_turn(_measured(task, task.base), base.missing)
        found: CellChanges = load(test.compare)(fits[-1].calibration, _measured(task, task.later))
    except CalibError as error:
        return Drift(base.path, later.path, reason=one_line(str(error)))
    reason = one_line(found.data_problem)
    return Drift(base.path, later.path, found.verdict, found.changes, found.rmse_mm, reason)


def _measured(task: DriftTask, judged: Judged) -> Dataset:
    dataset = load_dataset(Path(task.folder) / judged.row.path)
    return dataset if judged.found is None else dataset.with_points(judged.found)
