"""Chart of a watched cell: the error at check poses of each measurement."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.extras.watch.present.changes import change_phrases
from calib.extras.watch.watch import ChangeReport
from calib.html_text import escape
from inspector.figures.style import distinct_labels, figure, log_axis
from inspector.markup.parts.palette import BAD, DOUBT, GOOD, NEUTRAL

VERDICTS = {  # colour and marker, so that no verdict is told by its colour alone
    "unchanged": (GOOD, "circle"),
    "unclear": (DOUBT, "diamond"),
    "changed": (BAD, "square"),
}
_MANY_TIMES = 8.0  # the limit: from there on the axis is logarithmic


def control_chart(shown: Sequence[ChangeReport]) -> go.Figure:
    """Figure of each measurement's 3D RMSE with its expected value and limit for an unchanged cell."""
    x = list(range(1, len(shown) + 1))
    limits = [w.limit_mm for w in shown]
    lines = (
        ("limit where nothing changed (99.7 %)", limits, "dash"),
        ("likely where nothing changed", [w.likely_mm for w in shown], "dot"),
    )
    wide = [0.6, *x[1:-1], len(x) + 0.4] if len(x) > 1 else [0.6, 1.4]  # lines reach beyond the first and last

    def along(values: list[float]) -> list[float]:
        return values if len(x) > 1 else values * 2

    traces: list[dict[str, object]] = [
        {
            "type": "scatter", "mode": "lines", "name": name, "x": wide, "y": along(values), "hoverinfo": "skip",
            "line": {"color": NEUTRAL, "width": 1.5, "dash": dash},
        }
        for name, values, dash in lines
    ]  # fmt: skip
    for verdict, (colour, symbol) in VERDICTS.items():
        own = [(at, w) for at, w in zip(x, shown, strict=True) if w.verdict == verdict]
        if own:
            traces.append(
                {
                    "type": "scatter", "mode": "markers", "name": verdict, "x": [at for at, _ in own],
                    "y": [w.rmse_mm for _, w in own], "marker": {"size": 9, "color": colour, "symbol": symbol},
                    "customdata": [_said(w) for _, w in own],
                    "hovertemplate": "%{customdata}<br>%{y:.4g} mm<extra></extra>",
                }
            )  # fmt: skip
    names = [w.date[:10] for w in shown] if all(w.date for w in shown) else distinct_labels([w.name for w in shown])
    step = -(-len(x) // 8)
    high = max(w.rmse_mm for w in shown)
    scale: dict[str, object] = {"rangemode": "tozero"}
    if high > _MANY_TIMES * max(limits):
        low = min(w.likely_mm for w in shown)
        scale = log_axis(min(low, *(w.rmse_mm for w in shown)), high)
    return figure(
        traces,
        xaxis={
            "tickvals": x[::step], "ticktext": names[::step], "zeroline": False, "range": [0.6, len(x) + 0.4],
            "automargin": True,
        },
        yaxis={"title": "error at check poses, mm", "automargin": True, **scale},
        margin=(56, 14, 30, 34),
    )  # fmt: skip


def _said(w: ChangeReport) -> str:
    return escape("; ".join((f"{w.name} {w.date}".strip(), *change_phrases(w))))
