"""All that later measurements of one cell show: each by itself, and the series together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.extras.watch.series import FEWEST_CHECKS, SeriesReport, date_of, watch_series
from calib.extras.watch.watch import ChangeReport, report_of
from calib.screening.blunders import without_blunders


@dataclass(frozen=True)
class WatchedCell:
    """Change reports of later measurements, with what all show together."""

    seen: tuple[ChangeReport, ...]  # by date where all have one, else in the order given
    together: SeriesReport | None  # None for fewer than three checks whose tables are right

    @property
    def is_unchanged(self) -> bool:
        """Whether neither a check by itself nor the series shows a change."""
        steady = self.together is None or self.together.is_steady
        return steady and all(report.verdict == "unchanged" for report in self.seen)


def watched_cell(
    base: Calibration, later: Sequence[Dataset], *, scanner_moved: bool = False, tolerance_mm: float | None = None
) -> WatchedCell:
    """Change reports of later measurements against a calibration, and what they show together.

    Raises:
        FitError: as `watch` does.
        CalibError: a tolerance for fewer than three checks whose tables are right.
    """
    base, dates = without_blunders(base), [date_of(dataset.about.date) for dataset in later]
    if None not in dates:
        later = [later[k] for k in sorted(range(len(later)), key=lambda k: str(dates[k]))]
    seen = tuple(report_of(base, dataset, scanner_moved=scanner_moved) for dataset in later)
    right = [dataset for dataset, report in zip(later, seen, strict=True) if report.data_problem is None]
    if len(right) >= FEWEST_CHECKS and len({str(dataset.poses.setup[0]) for dataset in right}) == 1:
        return WatchedCell(seen, watch_series(base, right, scanner_moved=scanner_moved, tolerance_mm=tolerance_mm))
    if tolerance_mm is not None:
        raise CalibError(
            f"the time until a tolerance is reached takes {FEWEST_CHECKS} checks or more with one station of the "
            f"scanner; found {len(right)}"
        )
    return WatchedCell(seen, None)
