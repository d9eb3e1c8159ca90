"""Figures of what comes after a fit: more poses, the same cell later, many arms; see `fits`."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.errors import CalibError
from calib.fleet.result import Fleet
from calib.monitoring.watch import ChangeReport
from calib.planning.plan import Plan
from calib.validation.learning_curve import LearningCurve
from inspector.figures import (
    evidence_plots,
    fleet_plots,
    plan_plots,
    watch_plots,
)
from inspector.figures.results.alone import titled


def learning_curve(curve: LearningCurve, *, dark: bool = False) -> go.Figure:
    """RMS error of the poses that were fitted and of those held out, mm, against the number of poses fitted.

    Bars: the spread over draws of the poses. Where the two lines meet, more poses help no more.
    """
    drawn = evidence_plots.errors_by_poses(
        [s.poses for s in curve.steps], [s.train_rmse_mm for s in curve.steps],
        [s.held_out_rmse_mm for s in curve.steps], [s.spread_mm for s in curve.steps], dark=dark,
    )  # fmt: skip
    return titled(drawn, f"Would more poses help: {curve.dataset.name}", dark=dark)


def control_chart(seen: ChangeReport | Sequence[ChangeReport], *, dark: bool = False) -> go.Figure:
    """RMS error at the check poses of each later measurement, mm, against the limit of an unchanged cell."""
    shown_of = (seen,) if isinstance(seen, ChangeReport) else tuple(seen)
    if not shown_of:
        raise CalibError("no measurement to draw; give what calib.monitoring.watch.watch returned, one or several")
    return titled(watch_plots.control_chart(shown_of, dark=dark), "Control chart of the cell", dark=dark)


def plan_curve(plan: Plan, *, dark: bool = False) -> go.Figure:
    """Predicted error, mm, against the number of further poses, and the number from which more hardly help."""
    drawn = plan_plots.error_by_count(plan.curve_mm, len(plan.poses), plan.enough, dark=dark)
    return titled(drawn, f"What further poses promise: {plan.start.dataset.name}", dark=dark)


def fleet_errors(fleet: Fleet, *, dark: bool = False) -> go.Figure:
    """RMS error of every dataset of a fleet, mm: as delivered, with calibrated links, with all effects found."""
    rows = sorted((row for row in fleet.rows if row.error_mm is not None), key=lambda row: (row.error_mm, row.path))
    stages = [row.train if row.test.final_mm is None else row.test for row in rows]
    errors = [(stage.nominal_mm, stage.links_mm, stage.final_mm) for stage in stages]
    drawn = fleet_plots.fleet_errors([row.path for row in rows], errors, dark=dark)
    return titled(drawn, f"Errors of {len(rows)} datasets", dark=dark)
