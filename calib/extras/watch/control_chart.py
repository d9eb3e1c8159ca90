"""Several measurements of one cell over time: their order, the sizes of usual changes, and repeated poses."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np

from calib.calibration.result import Calibration
from calib.extras.watch.iso9283 import PoseFigures, Visits, pose_figures
from calib.extras.watch.watch import ChangeReport
from calib.frames import frames_by_name
from calib.validation.cell_changes import Change


def in_time(reports: Sequence[ChangeReport]) -> tuple[ChangeReport, ...]:
    """Change reports sorted by date where all have a date, else in the order given."""
    dates = [date_of(report.when) for report in reports]
    if any(date is None for date in dates):
        return tuple(reports)
    return tuple(report for _, report in sorted(zip(dates, reports, strict=True), key=lambda one: str(one[0])))


def date_of(text: str) -> datetime | None:
    """Date and time (UTC, without zone) of an `[about] date`; None where it is missing or no date."""
    try:
        date = datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    return date if date.tzinfo is None else (date - (date.utcoffset() or date - date)).replace(tzinfo=None)


def usual_name(change: Change) -> str:
    """Name of a change's column in a table: joint_zero_3_deg, tool_mm."""
    unit = "deg" if change.unit == "rad" else change.unit
    return f"{change.what}_{change.joint}_{unit}" if change.joint is not None else f"{change.what}_{unit}"


def size_in_degrees(change: Change) -> tuple[float, float]:
    """Size and sigma of a change, angles in degrees."""
    factor = np.degrees(1.0) if change.unit == "rad" else 1.0
    return float(factor * change.size), float(factor * change.sigma)


def repeated_poses(base: Calibration, reports: Sequence[ChangeReport]) -> tuple[PoseFigures, ...]:
    """ISO 9283 figures of every pose that was visited again; the earlier calibration is the first session."""
    dataset, errors = base.dataset, base.after
    points = dataset.points
    assert points is not None
    scanner_R_base = frames_by_name(errors.scanner_T_base, dataset.poses.setup[points.pose])[:, :3, :3]
    earlier = Visits(
        dataset.name,
        [dataset.poses.ids[i] for i in points.pose],
        dataset.poses.q[points.pose],
        [str(name) for name in points.target],
        -np.einsum("mki,mk->mi", scanner_R_base, errors.error_mm),
    )
    ordered = in_time(reports)
    figures = pose_figures([earlier, *(report.errors.visits(report.name) for report in ordered)])
    later = {report.name for report in ordered}
    return tuple(p for p in figures if any(s.session in later for s in p.sessions))
