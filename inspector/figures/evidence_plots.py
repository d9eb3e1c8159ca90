"""Figures of the evidence for each effect, and of the error against the number of poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import plotly.graph_objects as go

from calib.html_text import escape
from inspector.figures.style import figure, shortened
from inspector.markup.parts.palette import NEUTRAL, PROPOSAL, ROLE_COLOURS, UNKNOWN

NAMED, NOT_NAMED = "named by the diagnosis", "not named"
_MOST = 16  # effects that are shown


def evidence_bars(
    names: Sequence[str],
    log_evidence: Sequence[float],
    named: Sequence[bool],
    least: float,
) -> go.Figure:
    """Bars of the log evidence of the best `_MOST` effects in the given order; a line at the `least` for adding one."""
    labels = [shortened(name, 26) for name in names[:_MOST]]
    traces: list[dict[str, Any]] = []
    for trace, colour, of in ((NAMED, PROPOSAL, True), (NOT_NAMED, UNKNOWN, False)):
        at = [k for k in range(len(labels)) if named[k] is of]
        if at:
            traces.append(
                {
                    "type": "bar", "name": trace, "x": [labels[k] for k in at], "y": [log_evidence[k] for k in at],
                    "marker": {"color": colour}, "customdata": [escape(names[k]) for k in at],
                    "hovertemplate": "%{x}<br>log evidence %{y:.1f}<extra></extra>",
                }
            )  # fmt: skip
    if labels:
        traces.append(
            {
                "type": "scatter", "mode": "lines", "name": f"convincing: more than {least:g}",
                "x": [labels[0], labels[-1]], "y": [least, least], "hoverinfo": "skip",
                "line": {"color": NEUTRAL, "width": 2, "dash": "dash"},
            }
        )  # fmt: skip
    return figure(
        traces,
        xaxis={
            "title": "effect", "type": "category", "categoryorder": "array", "categoryarray": labels,
            "tickvals": labels, "ticktext": labels, "tickangle": -45, "tickfont": {"size": 10}, "automargin": True,
        },
        yaxis={"title": "log evidence over noise", "automargin": True},
        margin=(56, 14, 30, 10),
        layout={"bargap": 0.2, "barmode": "overlay"},
    )  # fmt: skip


def errors_by_poses(
    poses: Sequence[int],
    train_rmse_mm: Sequence[float],
    held_out_rmse_mm: Sequence[float],
    spread_mm: Sequence[float],
) -> go.Figure:
    """Figure of training and held-out error against the number of fitted poses; bars: spread of the held-out error."""
    traces = [
        {
            "type": "scatter", "mode": "lines+markers", "name": name, "x": list(poses), "y": list(values),
            "line": {"color": ROLE_COLOURS[role], "width": 2},
            "marker": {"size": 8, "symbol": symbol, "color": ROLE_COLOURS[role]},
            "hovertemplate": f"%{{x}} poses<br>{name} %{{y:.4g}} mm<extra></extra>", **more,
        }
        for name, role, symbol, values, more in (
            ("fitted poses", "train", "circle", train_rmse_mm, {}),
            (
                "held-out poses", "test", "diamond", held_out_rmse_mm,
                {"error_y": {"type": "data", "array": list(spread_mm), "thickness": 1.2, "width": 4}},
            ),
        )
    ]  # fmt: skip
    return figure(
        traces,
        xaxis={"title": "poses fitted", "zeroline": False, "rangemode": "tozero"},
        yaxis={"title": "3D RMSE, mm", "rangemode": "tozero", "automargin": True},
        margin=(56, 14, 30, 42),
    )
