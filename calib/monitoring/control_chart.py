"""Several measurements of one cell over time: the error at check poses against its limit, and what each would say."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np

from calib.calibration.result import Calibration
from calib.monitoring.change_tests import Change
from calib.monitoring.iso9283 import PoseFigures, Visits, pose_figures
from calib.monitoring.watch import ChangeReport


def in_time(seen: Sequence[ChangeReport]) -> tuple[ChangeReport, ...]:
    """By the dates that the datasets tell, where all of them do; else in the order given."""
    dates = [moment(w) for w in seen]
    if any(date is None for date in dates):
        return tuple(seen)
    return tuple(w for _, w in sorted(zip(dates, seen, strict=True), key=lambda one: str(one[0])))


def moment(seen: ChangeReport) -> datetime | None:
    """When it was measured, in universal time without a zone; None where `[about] date` tells none."""
    try:
        date = datetime.fromisoformat(seen.when.strip())
    except ValueError:
        return None
    return date if date.tzinfo is None else (date - (date.utcoffset() or date - date)).replace(tzinfo=None)


def usual_name(found: Change) -> str:
    """A column's name: joint_zero_3_deg, tool_mm."""
    unit = "deg" if found.unit == "rad" else found.unit
    return f"{found.what}_{found.joint}_{unit}" if found.joint is not None else f"{found.what}_{unit}"


def size_in_degrees(found: Change) -> tuple[float, float]:
    """Size and sigma, angles in degrees."""
    factor = np.degrees(1.0) if found.unit == "rad" else 1.0
    return float(factor * found.size), float(factor * found.sigma)


def repeated_poses(base: Calibration, seen: Sequence[ChangeReport]) -> tuple[PoseFigures, ...]:
    """ISO 9283's figures of every pose that was visited again, those of the earlier calibration first."""
    dataset, errors = base.dataset, base.after
    points = dataset.points
    assert points is not None
    turn = np.stack([errors.scanner_T_base[str(name)][:3, :3] for name in dataset.poses.setup[points.pose]])
    earlier = Visits(
        dataset.name,
        [dataset.poses.ids[i] for i in points.pose],
        dataset.poses.q[points.pose],
        [str(name) for name in points.target],
        -np.einsum("mki,mk->mi", turn, errors.error_mm),
    )
    watched = in_time(seen)
    found = pose_figures([earlier, *(w.errors.visits(w.name) for w in watched)])
    later = {w.name for w in watched}
    return tuple(p for p in found if any(s.session in later for s in p.sessions))
