"""Figures of the evidence for each effect, of what proofs explain, and of the error against the number of poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from calib.array_types import Array
from calib.diagnosis.decision_rules import MIN_LOG_EVIDENCE
from calib.html_text import escape
from inspector.figures.style import SELECTS_POSE, Part, figure, shortened
from inspector.markup.parts.palette import NEUTRAL, PROPOSAL, ROLE_COLOURS, UNKNOWN

NAMED, NOT_NAMED = "named by the diagnosis", "not named"
_MOST = 16  # effects that are shown


def evidence_bars(names: Sequence[str], log_evidence: Sequence[float], named: Sequence[bool]) -> go.Figure:
    """Bars of the log evidence of the best `_MOST` effects in the given order; a line at the least for adding one."""
    labels = [shortened(name, 26) for name in names[:_MOST]]
    traces: list[Part] = []
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
                "type": "scatter", "mode": "lines", "name": f"convincing: more than {MIN_LOG_EVIDENCE:g}",
                "x": [labels[0], labels[-1]], "y": [MIN_LOG_EVIDENCE] * 2, "hoverinfo": "skip",
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


def moved_by_change(moved_mm: Array, explained_mm: Array, ids: Sequence[str], held_out: Sequence[bool]) -> go.Figure:
    """Figure of measured displacements (P, 3) against those that the proven causes explain, with the line of agreement.

    held_out: (P,) which pairs no fit saw.
    """
    ends = [float(explained_mm.min(initial=0.0)), float(explained_mm.max(initial=0.0))]
    traces: list[Part] = []
    for name, role, of in (("fitted pairs, per coordinate", "train", False), ("held-out pairs", "test", True)):
        rows = np.flatnonzero(np.asarray(held_out, dtype=bool) == of)
        names = [escape(ids[k]) for k in np.repeat(rows, 3).tolist()]
        if len(rows):
            traces.append(
                {
                    "type": "scatter", "mode": "markers", "name": name, "x": explained_mm[rows].ravel().tolist(),
                    "y": moved_mm[rows].ravel().tolist(), "meta": {**SELECTS_POSE, "values": names},
                    "marker": {"size": 5, "color": ROLE_COLOURS[role], "opacity": 0.8}, "customdata": names,
                    "hovertemplate": "pose %{customdata}<br>proven causes: %{x:.3f} mm<br>"
                    "measured: %{y:.3f} mm<extra></extra>",
                }
            )  # fmt: skip
    traces.append(
        {
            "type": "scatter", "mode": "lines", "name": "agreement", "x": ends, "y": ends, "hoverinfo": "skip",
            "line": {"color": NEUTRAL, "width": 2},
        }
    )  # fmt: skip
    return figure(
        traces,
        xaxis={"title": "moved by the proven causes, mm", "automargin": True},
        yaxis={"title": "moved by the change, measured, mm", "automargin": True},
    )


def errors_by_poses(
    poses: Sequence[int], train_rmse_mm: Sequence[float], held_out_rmse_mm: Sequence[float], spread_mm: Sequence[float]
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
