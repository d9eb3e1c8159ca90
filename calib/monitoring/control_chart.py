"""Several measurements of one cell over time: the error at check poses against its limit, and what each would say."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

import numpy as np
import pandas as pd

from calib.calibration.result import Calibration
from calib.monitoring.change_tests import Found
from calib.monitoring.iso9283 import CAVEAT, PoseFigures, Visits, pose_figures
from calib.monitoring.watch import Watched


def in_time(seen: Sequence[Watched]) -> tuple[Watched, ...]:
    """By the dates that the datasets tell, where all of them do; else in the order given."""
    dates = [moment(w) for w in seen]
    if any(date is None for date in dates):
        return tuple(seen)
    return tuple(w for _, w in sorted(zip(dates, seen, strict=True), key=lambda one: str(one[0])))


def moment(seen: Watched) -> datetime | None:
    """When it was measured, in universal time without a zone; None where `[about] date` tells none."""
    try:
        date = datetime.fromisoformat(seen.when.strip())
    except ValueError:
        return None
    return date if date.tzinfo is None else (date - (date.utcoffset() or date - date)).replace(tzinfo=None)


def usual_name(found: Found) -> str:
    """A column's name: joint_zero_3_deg, tool_mm."""
    unit = "deg" if found.unit == "rad" else found.unit
    return f"{found.what}_{found.joint}_{unit}" if found.joint is not None else f"{found.what}_{unit}"


def shown_size(found: Found) -> tuple[float, float]:
    """Size and sigma, angles in degrees."""
    factor = np.degrees(1.0) if found.unit == "rad" else 1.0
    return float(factor * found.size), float(factor * found.sigma)


def series(seen: Sequence[Watched]) -> pd.DataFrame:
    """A row for each, in the order of time: error, limit, verdict, what changed, and the usual kinds' sizes."""
    rows = []
    for w in in_time(seen):
        row: dict[str, object] = {
            "name": w.name,
            "date": w.when,
            "verdict": w.verdict,
            "poses": w.poses,
            "rmse_mm": w.rmse_mm,
            "likely_mm": w.errors.likely_mm,
            "limit_mm": w.errors.limit_mm,
            "p_unchanged": w.p_unchanged,
            "changes": "; ".join(w.told),
        }
        for found in w.usual:
            name, unit = usual_name(found).rsplit("_", 1)
            size, sigma = shown_size(found)
            shown = (size, sigma) if np.isfinite(sigma) else (None, None)  # an empty cell: not seen by these poses
            row |= dict(zip((f"{name}_{unit}", f"{name}_sigma_{unit}"), shown, strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


def repeated_poses(base: Calibration, seen: Sequence[Watched]) -> tuple[PoseFigures, ...]:
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


def repeat_lines(repeats: Sequence[PoseFigures]) -> list[str]:
    """The worst of RP, dAP and dRP in a line, and what they are not; nothing where no pose was visited again."""
    if not repeats:
        return []
    worst = {
        "RP": [s.rp_mm for p in repeats for s in p.sessions],
        "dAP": [p.dap_mm for p in repeats],
        "dRP": [p.drp_mm for p in repeats],
    }
    told = [f"{name} {max(known):.3g} mm" for name, v in worst.items() if (known := [x for x in v if x is not None])]
    count = f"{len(repeats)} poses were visited again" if len(repeats) > 1 else "1 pose was visited again"
    return [f"{count}, at the most {', '.join(told)}. {CAVEAT}"]
