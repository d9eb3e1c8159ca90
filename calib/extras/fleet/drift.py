"""Changes of one arm from one dataset to the next, where a plug-in tests for changes (`watch` does)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.search_space import add_in_turn
from calib.errors import CalibError
from calib.extras.fleet.judge import FleetOptions, Judged, key_of, one_line
from calib.extras.fleet.row import Row
from calib.plugins import contributions, load
from calib.validation.cell_changes import NOT_OF_THE_ARM, CellChanges, Change, ChangeTest


@dataclass(frozen=True)
class Drift:
    """Changes between two datasets of one arm: the later points against the earlier calibration."""

    base: str  # path
    later: str
    verdict: str  # unchanged, changed, unclear; "" where they cannot be compared
    changes: tuple[Change, ...]
    rmse_mm: float | None  # 3D error of the later points by the earlier calibration
    expected_mm: float | None  # part of rmse_mm that noise alone makes
    poses: int = 0  # of the later dataset that were compared
    reason: str = ""  # why they cannot be compared, or what is wrong with the later poses.csv; one line
    settled: bool = True  # whether another try with the same files would give the same

    @property
    def of_the_arm(self) -> tuple[Change, ...]:
        """Changes of the arm itself, where the verdict is unambiguous."""
        clear = self.verdict == "changed"
        return tuple(c for c in self.changes if clear and c.what not in NOT_OF_THE_ARM)


@dataclass(frozen=True)
class DriftTask:
    """Task of comparing two datasets of an arm, given by their paths and what was found in scans."""

    folder: str
    base: Judged
    later: Judged
    options: FleetOptions

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
    dated = sorted((row for row in rows if row.serial and row.date), key=lambda row: (row.arm, row.date, row.path))
    out = []
    for later in range(1, len(dated)) if change_test() is not None else ():
        row = dated[later]
        earlier = (other for other in reversed(dated[:later]) if other.arm == row.arm)
        base = next((other for other in earlier if other.verdict and other.date < row.date), None)
        if base is not None:
            out.append((base, row))
    return out


def compare(task: DriftTask) -> Drift:
    """Changes between two datasets of an arm, or the reason why they cannot be compared."""
    base, later = task.base.row, task.later.row
    test = change_test()
    assert test is not None  # or there was no pair to compare
    try:
        fits = add_in_turn(_measured(task, task.base), base.missing, task.options.fit.with_residual("position"))
        found: CellChanges = load(test.compare)(fits[-1].calibration, _measured(task, task.later))
    except CalibError as error:
        return Drift(base.path, later.path, "", (), None, None, reason=one_line(str(error)))
    return Drift(
        base.path, later.path, found.verdict, found.changes, found.rmse_mm, found.expected_mm, found.poses,
        one_line(found.data_problem),
    )  # fmt: skip


def _measured(task: DriftTask, judged: Judged) -> Dataset:
    dataset = load_dataset(Path(task.folder) / judged.row.path)
    return dataset if judged.found is None else dataset.with_points(judged.found)
