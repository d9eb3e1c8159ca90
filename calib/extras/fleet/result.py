"""The result of a fleet: rows, shared causes, and failures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calib.extras.fleet.row import Failure, Row
from calib.extras.fleet.shared_causes import SharedCause
from calib.presented import Presented


@dataclass(frozen=True)
class Fleet(Presented):
    """Rows of all datasets below a folder, in the order of their paths, with shared causes and failures."""

    folder: Path
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]  # datasets without a row, and folders that could not be looked into
    shared: tuple[SharedCause, ...]
    taken_over: int  # number of rows of an earlier run, whose files have not changed
    seconds: float  # sum over the datasets, on all workers

    def worst(self, count: int = 10) -> tuple[Row, ...]:
        """Rows of the datasets with the largest error of the last model."""
        return tuple(sorted(self.rows, key=lambda row: (-(row.error_mm or 0.0), row.path))[:count])

    def _brief(self) -> str:
        passed = sum(row.passed for row in self.rows)
        return f"{self.folder.name}: {passed} of {len(self.rows)} datasets pass, {len(self.failures)} failed"
