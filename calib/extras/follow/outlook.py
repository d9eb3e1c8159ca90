"""Outlook of a running campaign: the error predicted now, the best next poses, and whether more would pay."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.result import Calibration
from calib.dataset.dataset import Poses
from calib.errors import CalibError
from calib.planning.criterion import DesignProblem
from calib.planning.exchange import best_poses
from calib.planning.prediction import PAYS, STEP, Prediction, Region, predicted
from calib.planning.start import FromFit
from calib.workcell.candidates import candidate_poses

NAMED = 3
"""Number of next poses that are named, the best first."""
_CANDIDATES, _REGION = 200, 200  # poses that are drawn in the cell, once for a campaign
_FEWEST_TEST = 5  # planned test poses that make a region


@dataclass(frozen=True, eq=False)
class DrawnPoses(Brief):
    """Joints that can be measured in the cell of a campaign, drawn once so that predictions of it compare."""

    region: Array  # (R, n) at which the error is predicted
    candidates: Array  # (N, n) to choose next poses from, where the plan has none left


@dataclass(frozen=True)
class NextPose(Brief):
    """Pose to measure next: one of the plan, or joints of its own."""

    pose: str | None
    q: Array  # (n,) rad, mm for prismatic joints
    setup: str


@dataclass(frozen=True)
class Outlook(Brief):
    """Predicted error of a campaign, what further poses would do to it, and the best of these."""

    region: str
    now: Prediction
    then_mm: float  # predicted error with `further` more of the best poses, without noise
    further: int
    next: tuple[NextPose, ...]

    @property
    def pays(self) -> bool:
        """Whether the best further poses lower the predicted error by more than 5 % for five of them."""
        return self.further > 0 and self.then_mm < (1.0 - PAYS * self.further / STEP) * self.now.geometry_mm


def drawn_poses(calibration: Calibration) -> DrawnPoses | None:
    """Poses that can be measured, drawn in the cell that a fit knows; None where too few can be."""
    try:
        q = candidate_poses(FromFit(calibration).cell, _REGION + _CANDIDATES, rng=np.random.default_rng(0))
    except CalibError:
        return None
    return DrawnPoses(q[:_REGION], q[_REGION:])


def needs_drawn_poses(planned: Poses, open_poses: Collection[str]) -> bool:
    """Whether an outlook takes poses drawn in the cell: without enough test poses, or without planned poses left."""
    left = [i for i in open_poses if not planned.is_test[planned.index(i)]]
    return int(planned.is_test.sum()) < _FEWEST_TEST or not left


def outlook_of(
    calibration: Calibration, planned: Poses, open_poses: Collection[str], drawn: DrawnPoses | None
) -> Outlook | None:
    """Outlook by a fit of what has arrived.

    Args:
        calibration: the fit.
        planned: all poses of the campaign, measured or not.
        open_poses: ids of those that are still to be measured, or measured again.
        drawn: poses of the cell.

    Returns:
        None where neither the plan nor the cell has poses to predict the error at.
    """
    start = FromFit(calibration)
    unknowns = start.unknowns()
    placed = np.isin(planned.setup, list(unknowns.scanner_T_base))
    test = np.flatnonzero(planned.is_test & placed)
    if len(test) >= _FEWEST_TEST:
        name, there = f"the {len(test)} test poses", planned.select(test)
    elif drawn is not None:
        name, there = "the poses that can be measured", start.poses_at(drawn.region)
    else:
        name, there = "the planned poses", planned.select(np.flatnonzero(placed))
    if not len(there):
        return None
    region = Region.of(name, there, unknowns, start.missed_mm2(there))
    rows = np.flatnonzero(placed & ~planned.is_test & np.isin(planned.ids, list(open_poses)))
    ids: list[str | None] = [planned.ids[i] for i in rows]
    offered = planned.select(rows)
    if not len(rows) and drawn is not None:
        offered = start.poses_at(drawn.candidates)
        ids = [None] * len(offered)
    now = predicted(region, unknowns.prior_information, unknowns.noise_dof, np.random.default_rng(0))
    if not len(offered):
        return Outlook(name, now, now.geometry_mm, 0, ())
    problem = DesignProblem(start, unknowns, offered, unknowns.rows(offered), region)
    chosen = best_poses([problem.region_question], min(STEP, len(offered)), exchange=False)
    then_mm = float(np.sqrt(np.exp(chosen.greedy_log_values[-1]) + region.missed_mm2))
    best = [NextPose(ids[i], offered.q[i], str(offered.setup[i])) for i in chosen.rows[:NAMED]]
    return Outlook(name, now, then_mm, len(chosen.rows), tuple(best))
