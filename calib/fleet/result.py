"""The result of a fleet: its rows, what they say together, and what failed."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from calib.diagnosis.words.phrases import length_text
from calib.display.shown import Documented
from calib.fleet.drift import Drift
from calib.fleet.row import Failure, Row
from calib.fleet.shared_causes import SharedCause

_TOLD = 10  # arms that changed, one by one


@dataclass(frozen=True)
class Fleet(Documented):
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

    def summary(self) -> str:
        """The counts, what the fleet has in common, what changed, what is worst and what failed."""
        passed = sum(row.passed for row in self.rows)
        told = ", ".join(f"{count} {verdict or 'without a verdict'}" for verdict, count in self.verdicts.items())
        lines = [
            f"{len(self.rows)} datasets of {self.arms} arms: {passed} pass the check; {told or 'none judged'}",
        ]
        if self.taken_over:
            lines.append(f"{self.taken_over} were judged by an earlier run and have not changed")
        lines += [cause.words for cause in self.shared]
        by_arm = {self.row(drift.later).serial: drift for drift in self.drifted}
        lines += [f"arm {serial} changed: {drift.words}" for serial, drift in sorted(by_arm.items())[:_TOLD]]
        if len(by_arm) > _TOLD:
            lines.append(f"{len(by_arm) - _TOLD} further arms changed")
        lines += [
            f"worst: {row.path}: {length_text(row.error_mm)}, {row.headline}"
            for row in self.worst(3)
            if row.error_mm is not None
        ]
        lines += [f"FAILED {failure.path}: {failure.reason}" for failure in self.failures]
        return "\n".join(lines)
