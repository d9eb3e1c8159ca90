"""The result of a fleet: rows, changes of arms, shared causes, and failures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from calib.extras.fleet.drift import Drift
from calib.extras.fleet.row import Failure, Row
from calib.extras.fleet.shared_causes import SharedCause
from calib.presented import Presented


@dataclass(frozen=True)
class Fleet(Presented):
    """Rows of all datasets below a folder, in the order of their paths, with drifts, shared causes and failures."""

    folder: Path
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]  # datasets without a row, and folders that could not be looked into
    drifts: tuple[Drift, ...]
    shared: tuple[SharedCause, ...]
    taken_over: int  # number of rows of an earlier run, whose files have not changed
    seconds: float  # sum over the datasets, on all workers

    @property
    def drifted(self) -> tuple[Drift, ...]:
        """Pairs of datasets between which the arm itself changed."""
        return tuple(drift for drift in self.drifts if drift.of_the_arm)

    @property
    def arms(self) -> int:
        """Number of arms that were measured."""
        return len({row.arm for row in self.rows})

    @property
    def verdicts(self) -> dict[str, int]:
        """Number of datasets by verdict, the most frequent first; "" stands for no verdict."""
        counts = Counter(row.verdict for row in self.rows)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    def row(self, path: str) -> Row:
        """Row of a dataset, by the dataset's path."""
        return self._by_path[path]

    @cached_property
    def _by_path(self) -> dict[str, Row]:
        return {row.path: row for row in self.rows}

    def worst(self, count: int = 10) -> tuple[Row, ...]:
        """Rows of the datasets with the largest error of the last model."""
        known = [(row.error_mm, row) for row in self.rows if row.error_mm is not None]
        return tuple(row for _, row in sorted(known, key=lambda item: (-item[0], item[1].path))[:count])

    def _brief(self) -> str:
        passed = sum(row.passed for row in self.rows)
        return f"{self.folder.name}: {passed} of {len(self.rows)} datasets pass, {len(self.failures)} failed"
