"""The result of a fleet: its rows, what they say together, and what failed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from calib.fleet.drift import Drift
from calib.fleet.row import Failure, Row
from calib.fleet.shared_causes import SharedCause
from calib.presented import Presented


@dataclass(frozen=True)
class Fleet(Presented):
    """All datasets below a folder, in the order of their paths, whoever judged them in whichever order."""

    folder: Path
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...]  # datasets without a row, and folders that could not be looked into
    drifts: tuple[Drift, ...]
    shared: tuple[SharedCause, ...]
    taken_over: int  # rows of an earlier run, whose files have not changed
    seconds: float  # that the datasets took in sum, on whatever ran them

    @property
    def drifted(self) -> tuple[Drift, ...]:
        """Pairs between which the arm itself changed."""
        return tuple(drift for drift in self.drifts if drift.of_the_arm)

    @property
    def arms(self) -> int:
        """How many arms were measured."""
        return len({row.arm for row in self.rows})

    @property
    def verdicts(self) -> dict[str, int]:
        """How many datasets have which verdict, the most frequent first; "" for those without one."""
        counts = Counter(row.verdict for row in self.rows)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    def row(self, path: str) -> Row:
        """The row of a dataset that has one."""
        return next(row for row in self.rows if row.path == path)

    def worst(self, count: int = 10) -> tuple[Row, ...]:
        """The rows with the largest last error."""
        known = [(row.error_mm, row) for row in self.rows if row.error_mm is not None]
        return tuple(row for _, row in sorted(known, key=lambda item: (-item[0], item[1].path))[:count])
