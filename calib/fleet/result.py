"""The result of a fleet: rows, changes of arms, shared causes, and failures."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from calib.diagnosis.words.phrases import length_text
from calib.display.brief import Brief
from calib.display.shown import Documented
from calib.fleet.drift import Drift
from calib.fleet.row import Failure, Row
from calib.fleet.shared_causes import SharedCause

_LISTED = 10  # changed arms that a summary lists


@dataclass(frozen=True)
class Fleet(Brief, Documented):
    """Judgements of all datasets below a folder, in the order of their paths."""

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
        """Number of datasets by verdict, the most frequent first; "" is no verdict."""
        counts = Counter(row.verdict for row in self.rows)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    def row(self, path: str) -> Row:
        """The row of a dataset, by its path."""
        return next(row for row in self.rows if row.path == path)

    def worst(self, count: int = 10) -> tuple[Row, ...]:
        """The rows with the largest last error."""
        known = [(row.error_mm, row) for row in self.rows if row.error_mm is not None]
        return tuple(row for _, row in sorted(known, key=lambda item: (-item[0], item[1].path))[:count])

    def summary(self) -> str:
        """Counts of verdicts, shared causes, changed arms, the worst datasets, and failures, a line each."""
        passed = sum(row.passed for row in self.rows)
        verdicts = ", ".join(f"{count} {verdict or 'without a verdict'}" for verdict, count in self.verdicts.items())
        lines = [
            f"{len(self.rows)} datasets of {self.arms} arms: {passed} pass the check; {verdicts or 'none judged'}",
        ]
        if self.taken_over:
            lines.append(f"{self.taken_over} were judged by an earlier run and have not changed")
        lines += [cause.words for cause in self.shared]
        by_arm = {self.row(drift.later).serial: drift for drift in self.drifted}
        lines += [f"arm {serial} changed: {drift.words}" for serial, drift in sorted(by_arm.items())[:_LISTED]]
        if len(by_arm) > _LISTED:
            lines.append(f"{len(by_arm) - _LISTED} further arms changed")
        lines += [
            f"worst: {row.path}: {length_text(row.error_mm)}, {row.headline}"
            for row in self.worst(3)
            if row.error_mm is not None
        ]
        lines += [f"FAILED {failure.path}: {failure.reason}" for failure in self.failures]
        return "\n".join(lines)

    def _brief(self) -> str:
        return f"{self.folder.name}: {self.summary().partition(chr(10))[0]}; {len(self.failures)} failed"
