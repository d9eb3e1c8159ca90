"""Figure of the predicted error of a plan against the number of measured poses."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.array_types import Array
from inspector.figures.style import EDGE, figure
from inspector.markup.parts.palette import NEUTRAL, PROPOSAL


def error_by_count(curve_mm: Array, planned: int, enough: int | None) -> go.Figure:
    """Figure of the predicted error by number of new poses, with the planned number and the end of useful gains.

    curve_mm  # (n + 1,); values that are not finite are left out
    """
    count = list(range(len(curve_mm)))
    inside = [k for k in count if curve_mm[k] < 1e3]
    traces = [
        {
            "type": "scatter", "mode": "lines+markers", "name": "predicted error", "x": inside,
            "y": [float(curve_mm[k]) for k in inside], "line": {"width": 2, "color": PROPOSAL},
            "marker": {"size": 5, "color": PROPOSAL}, "hovertemplate": "%{x} new poses<br>%{y:.3g} mm<extra></extra>",
        },
        {
            "type": "scatter", "mode": "markers", "name": "this plan", "x": [planned], "y": [float(curve_mm[planned])],
            "marker": {"size": 12, "color": PROPOSAL, "line": {"width": 2, "color": EDGE}},
            "hovertemplate": "this plan: %{x} poses<br>%{y:.3g} mm<extra></extra>",
        },
    ]  # fmt: skip
    if enough is not None and enough in inside:
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": "from here more hardly pay", "x": [enough],
                "y": [float(curve_mm[enough])], "marker": {"size": 11, "color": NEUTRAL, "symbol": "diamond"},
                "hovertemplate": "from %{x} new poses on, five more lower it by less than 5 %<extra></extra>",
            }
        )  # fmt: skip
    return figure(
        traces,
        xaxis={"title": "new poses", "zeroline": False},
        yaxis={"title": "predicted error, mm", "rangemode": "tozero", "automargin": True},
        margin=(50, 12, 44, 42),
    )
