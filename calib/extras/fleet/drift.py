"""Changes of one arm from one dataset to the next, where a plug-in tests for changes (`watch` does)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.search_space import add_in_turn
from calib.errors import CalibError
from calib.extras.fleet.judge import FleetOptions, FoundCorners, one_line
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
    """Task of comparing two datasets of an arm, given by their paths and corners."""

    folder: str
    base: str
    later: str
    effects: tuple[str, ...]  # claimed by the earlier dataset's diagnosis
    base_corners: FoundCorners | None
    later_corners: FoundCorners | None
    options: FleetOptions


def change_test() -> ChangeTest | None:
    """The test for changes that a plug-in brings; None without one, and then no datasets are compared."""
    return next(iter(contributions(ChangeTest)), None)


def consecutive(rows: Iterable[Row]) -> list[tuple[Row, Row]]:
    """Pairs of datasets of one arm: each dataset with the last fitted one of an earlier date.

    Datasets without a serial number or a date are in no pair. A few check poses are too few for a fit and are compared
    with the last calibration before them.
    """
    dated = sorted((row for row in rows if row.serial and row.date), key=lambda row: (row.arm, row.date, row.path))
    out = []
    for later in range(1, len(dated)):
        row = dated[later]
        earlier = (other for other in reversed(dated[:later]) if other.arm == row.arm)
        base = next((other for other in earlier if other.verdict and other.date < row.date), None)
        if base is not None:
            out.append((base, row))
    return out


def compare(task: DriftTask) -> Drift:
    """Changes between two datasets of an arm, or the reason why they cannot be compared."""
    try:
        return _compared(task)
    except CalibError as error:
        return Drift(task.base, task.later, "", (), None, None, reason=one_line(str(error)))


def _compared(task: DriftTask) -> Drift:
    base = _measured(task, task.base, task.base_corners)
    later = _measured(task, task.later, task.later_corners)
    calibration = add_in_turn(base, task.effects, task.options.fit.with_residual("position"))[-1].calibration
    test = change_test()
    assert test is not None  # or there was no pair to compare
    found: CellChanges = load(test.compare)(calibration, later)
    return Drift(
        task.base,
        task.later,
        found.verdict,
        found.changes,
        found.rmse_mm,
        found.expected_mm,
        found.poses,
        one_line(found.data_problem),
    )


def _measured(task: DriftTask, path: str, corners: FoundCorners | None) -> Dataset:
    dataset = load_dataset(Path(task.folder) / path)
    return dataset if corners is None or dataset.points is not None else corners.as_points_of(dataset)
