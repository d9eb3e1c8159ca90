"""Figure of a watched cell, as `inspector.figures` offers it."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.errors import CalibError
from calib.extras.watch.watch import ChangeReport
from inspector.extras.watch import watch_plots
from inspector.figures.results.alone import titled


def control_chart(seen: ChangeReport | Sequence[ChangeReport]) -> go.Figure:
    """Figure of the RMS error at check poses of each later measurement, mm, with the limit of an unchanged cell."""
    shown_of = (seen,) if isinstance(seen, ChangeReport) else tuple(seen)
    if not shown_of:
        raise CalibError("no measurement to draw; give what calib.extras.watch.watch returned, one or several")
    return titled(watch_plots.control_chart(shown_of), "Control chart of the cell")
