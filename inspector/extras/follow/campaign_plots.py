"""Figure of a running campaign: the predicted error against the number of good poses."""

from __future__ import annotations

from typing import Any

import plotly.graph_objects as go

from calib.extras.follow.campaign import Campaign
from inspector.figures.style import figure
from inspector.markup.parts.palette import PROPOSAL

BAND = "rgba(128, 128, 128, 0.25)"


def predicted_error(campaign: Campaign) -> go.Figure:
    """Figure of the predicted error, with the band of 90 % of arms, by number of good poses."""
    x = [count for count, _ in campaign.history]
    now = [prediction for _, prediction in campaign.history]
    band: dict[str, Any] = {
        "type": "scatter", "mode": "lines", "x": x, "hoverinfo": "skip", "line": {"width": 0},
    }  # fmt: skip
    traces: list[dict[str, Any]] = [
        {**band, "name": "low", "y": [p.low_mm for p in now], "showlegend": False},
        {**band, "name": "90 % of arms", "y": [p.high_mm for p in now], "fill": "tonexty", "fillcolor": BAND},
        {
            "type": "scatter", "mode": "lines+markers", "name": "predicted error", "x": x,
            "y": [p.geometry_mm for p in now], "line": {"width": 2, "color": PROPOSAL},
            "marker": {"size": 5, "color": PROPOSAL}, "hovertemplate": "%{x} good poses<br>%{y:.3g} mm<extra></extra>",
        },
    ]  # fmt: skip
    return figure(
        traces,
        xaxis={"title": "good poses", "zeroline": False},
        yaxis={"title": "predicted error, mm", "rangemode": "tozero", "automargin": True},
        margin=(50, 12, 44, 42),
    )
