"""Pose repeatability and drift of accuracy over several measurements, by the formulas of ISO 9283.

For n visits of one pose l_j is the distance of visit j from their barycentre, RP = mean(l) + 3 S_l with n - 1 in S_l
(7.2.3). AP is the distance of the barycentre from the commanded point (7.2.1); dAP and dRP are the largest differences
of AP and RP from those of the first session (7.5). Here the commanded point is the earlier calibration's prediction in
a frame that was itself fitted: AP is relative to that, and none of this is a certificate, which takes thirty visits at
the standard's own poses, loads and speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array

CAVEAT = (
    "By the formulas of ISO 9283, no certificate: AP is relative to the earlier fit and its scanner frame, a moved "
    "scanner counts as drift, and the standard asks for thirty visits."
)
_SAME = 1e-5  # rad or mm, difference of joints up to which two poses are one


@dataclass(frozen=True)
class Visits:
    """Points measured in one session, with their deviations (M) from the commanded points."""

    session: str
    pose_ids: Sequence[str]  # (M,)
    q: Array  # (M, n)
    target: Sequence[str]  # (M,)
    off_mm: Array  # (M, 3) base frame


@dataclass(frozen=True)
class SessionFigures:
    """ISO 9283 figures of one pose in one session."""

    session: str
    pose: str
    visits: int
    barycentre_mm: Array  # (3,) minus the commanded point
    rp_mm: float | None  # None for a single visit

    @property
    def ap_mm(self) -> float:
        """Distance of the barycentre from the commanded point, mm."""
        return float(np.linalg.norm(self.barycentre_mm))


@dataclass(frozen=True)
class PoseFigures:
    """ISO 9283 figures of one pose over the sessions in which it was visited, in their order."""

    sessions: tuple[SessionFigures, ...]

    @property
    def pose(self) -> str:
        """Name of the pose in the first session."""
        return self.sessions[0].pose

    @property
    def dap_mm(self) -> float | None:
        """Drift of accuracy: largest difference of AP from the first session's, mm; None for one session."""
        return _drift([s.ap_mm for s in self.sessions])

    @property
    def drp_mm(self) -> float | None:
        """Drift of repeatability: largest difference of RP from the first session with repeats, mm; or None."""
        return _drift([s.rp_mm for s in self.sessions if s.rp_mm is not None])

    @property
    def moved_mm(self) -> float | None:
        """Largest distance, mm, of a session's barycentre from the first session's; None for one session."""
        first = self.sessions[0].barycentre_mm
        away = [float(np.linalg.norm(s.barycentre_mm - first)) for s in self.sessions[1:]]
        return max(away, default=None)


def repeatability_mm(xyz_mm: Array) -> float:
    """Repeatability RP, mm, of the points (n, 3) of two or more visits."""
    away = np.linalg.norm(xyz_mm - xyz_mm.mean(axis=0), axis=1)
    return float(away.mean() + 3.0 * away.std(ddof=1))


def pose_figures(sessions: Sequence[Visits]) -> tuple[PoseFigures, ...]:
    """ISO 9283 figures of every pose that was visited more than once, within a session or over several."""
    by_pose: dict[tuple[object, ...], list[SessionFigures]] = {}
    for visits in sessions:
        rows_of: dict[tuple[object, ...], list[int]] = {}
        joints = np.round(visits.q / _SAME).astype(np.int64).tolist()
        for row, (target, q) in enumerate(zip(visits.target, joints, strict=True)):
            rows_of.setdefault((target, *q), []).append(row)
        for key, rows in rows_of.items():
            off_mm = visits.off_mm[rows]
            rp_mm = repeatability_mm(off_mm) if len(rows) > 1 else None
            figures = SessionFigures(visits.session, visits.pose_ids[rows[0]], len(rows), off_mm.mean(axis=0), rp_mm)
            by_pose.setdefault(key, []).append(figures)
    several = (figures for figures in by_pose.values() if len(figures) > 1 or figures[0].visits > 1)
    return tuple(PoseFigures(tuple(figures)) for figures in several)


def _drift(values: Sequence[float]) -> float | None:
    """Largest difference of later values from the first value; None for fewer than two values."""
    return max((abs(v - values[0]) for v in values[1:]), default=None)
