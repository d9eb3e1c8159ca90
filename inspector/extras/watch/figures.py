"""Figures of a watched cell, as `inspector.figures` offers them."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.errors import CalibError
from calib.extras.watch.series import SeriesReport
from calib.extras.watch.watch import ChangeReport
from inspector.extras.watch import watch_plots
from inspector.figures.results.alone import titled


def control_chart(seen: ChangeReport | Sequence[ChangeReport], *, dark: bool = False) -> go.Figure:
    """Figure of the RMS error at check poses of each later measurement, mm, with the limit of an unchanged cell."""
    shown_of = (seen,) if isinstance(seen, ChangeReport) else tuple(seen)
    if not shown_of:
        raise CalibError("no measurement to draw; give what calib.extras.watch.watch returned, one or several")
    return titled(watch_plots.control_chart(shown_of), "Control chart of the cell", dark=dark)


def series_chart(found: SeriesReport, *, dark: bool = False) -> go.Figure:
    """Figure of one change's size at each check of a series: of what drifts or steps, else the least likely of all."""
    if found.shown is None:
        raise CalibError("no change shows at these check poses, so there is nothing to draw")
    return titled(watch_plots.series_chart(found), "Over the checks", dark=dark)
