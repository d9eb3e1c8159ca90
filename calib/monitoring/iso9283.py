"""Repeatability and drift of accuracy of poses that were measured several times, by the formulas of ISO 9283.

Of n visits of one pose: l_j is the distance of visit j from their barycentre, RP = mean(l) + 3 S_l with n - 1 in S_l
(7.2.3). AP is the distance of the barycentre from the commanded point (7.2.1); dAP and dRP are by how much AP and RP
differ from those of the first session, at the most (7.5). Here the commanded point is where the earlier calibration
predicts it in a frame that was itself fitted: AP is relative to that, and none of this is a certificate, which takes
thirty visits at the standard's own poses, loads and speeds.
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
_SAME = 1e-5  # rad or mm by which joints may differ within one pose


@dataclass(frozen=True)
class Visits:
    """Measured minus commanded at M points of one session."""

    session: str
    pose_ids: Sequence[str]  # (M,)
    q: Array  # (M, n)
    target: Sequence[str]  # (M,)
    off_mm: Array  # (M, 3) base frame


@dataclass(frozen=True)
class SessionFigures:
    """One pose in one session."""

    session: str
    pose: str
    visits: int
    barycentre_mm: Array  # (3,) from the commanded point
    rp_mm: float | None  # None of a single visit

    @property
    def ap_mm(self) -> float:
        """The barycentre's distance from the commanded point."""
        return float(np.linalg.norm(self.barycentre_mm))


@dataclass(frozen=True)
class PoseFigures:
    """One pose over the sessions in which it was visited, in their order."""

    sessions: tuple[SessionFigures, ...]

    @property
    def pose(self) -> str:
        """The pose's name in the first session."""
        return self.sessions[0].pose

    @property
    def dap_mm(self) -> float | None:
        """By how much AP differs from the first session's, at the most; None of one session."""
        return _drift([s.ap_mm for s in self.sessions])

    @property
    def drp_mm(self) -> float | None:
        """The same of RP, of sessions with repeats."""
        return _drift([s.rp_mm for s in self.sessions if s.rp_mm is not None])

    @property
    def moved_mm(self) -> float | None:
        """How far the barycentre went from the first session's, at the most, whatever way: AP may stay the same."""
        first = self.sessions[0].barycentre_mm
        away = [float(np.linalg.norm(s.barycentre_mm - first)) for s in self.sessions[1:]]
        return max(away, default=None)


def repeatability_mm(xyz_mm: Array) -> float:
    """RP of n visits (n, 3), n of 2 or more."""
    away = np.linalg.norm(xyz_mm - xyz_mm.mean(axis=0), axis=1)
    return float(away.mean() + 3.0 * away.std(ddof=1))


def pose_figures(sessions: Sequence[Visits]) -> tuple[PoseFigures, ...]:
    """The figures of every pose that was visited more than once, within a session or over several."""
    found: dict[tuple[object, ...], list[SessionFigures]] = {}
    for visits in sessions:
        rows_of: dict[tuple[object, ...], list[int]] = {}
        places = np.round(visits.q / _SAME).astype(np.int64).tolist()
        for row, (target, place) in enumerate(zip(visits.target, places, strict=True)):
            rows_of.setdefault((target, *place), []).append(row)
        for key, rows in rows_of.items():
            off_mm = visits.off_mm[rows]
            rp_mm = repeatability_mm(off_mm) if len(rows) > 1 else None
            figures = SessionFigures(visits.session, visits.pose_ids[rows[0]], len(rows), off_mm.mean(axis=0), rp_mm)
            found.setdefault(key, []).append(figures)
    several = (figures for figures in found.values() if len(figures) > 1 or figures[0].visits > 1)
    return tuple(PoseFigures(tuple(figures)) for figures in several)


def _drift(values: Sequence[float]) -> float | None:
    return max((abs(v - values[0]) for v in values[1:]), default=None)
