"""Chart of a watched cell: the error at check poses of each measurement."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.errors import CalibError
from calib.extras.watch.present.changes import change_phrases
from calib.extras.watch.watch import ChangeReport
from calib.html_text import escape
from inspector.figures.results.alone import titled
from inspector.figures.style import figure, log_axis, shortened
from inspector.markup.parts.palette import BAD, DOUBT, GOOD, NEUTRAL

VERDICTS = {  # colour and marker, so that no verdict is told by its colour alone
    "unchanged": (GOOD, "circle"),
    "unclear": (DOUBT, "diamond"),
    "changed": (BAD, "square"),
}
_MANY_TIMES = 8.0  # the limit: from there on the axis is logarithmic


def control_chart(seen: ChangeReport | Sequence[ChangeReport]) -> go.Figure:
    """Figure of the RMS error at check poses of each later measurement, mm, with the limit of an unchanged cell."""
    shown = (seen,) if isinstance(seen, ChangeReport) else tuple(seen)
    if not shown:
        raise CalibError("no measurement to draw; give what calib.extras.watch.watch returned, one or several")
    return titled(chart(shown), "Control chart of the cell")


def chart(shown: Sequence[ChangeReport]) -> go.Figure:
    """The control chart without a title, for the page."""
    x = [k - 0.5 for k in range(len(shown) + 1)]  # the limit of each reaches half way to its neighbours
    limits = [w.limit_mm for w in shown]
    traces: list[dict[str, object]] = [
        {
            "type": "scatter", "mode": "lines", "name": "limit where nothing changed (99.7 %)", "x": x,
            "y": [*limits, limits[-1]], "hoverinfo": "skip",
            "line": {"color": NEUTRAL, "width": 1.5, "dash": "dash", "shape": "hv"},
        }
    ]  # fmt: skip
    for verdict, (colour, symbol) in VERDICTS.items():
        own = [(at, w) for at, w in enumerate(shown) if w.verdict == verdict]
        if own:
            traces.append(
                {
                    "type": "scatter", "mode": "markers", "name": verdict, "x": [at for at, _ in own],
                    "y": [w.rmse_mm for _, w in own], "marker": {"size": 9, "color": colour, "symbol": symbol},
                    "customdata": [_said(w) for _, w in own],
                    "hovertemplate": "%{customdata}<br>%{y:.4g} mm<extra></extra>",
                }
            )  # fmt: skip
    names = [w.date[:10] for w in shown] if all(w.date for w in shown) else [shortened(w.name, 12) for w in shown]
    every = slice(None, None, -(-len(shown) // 8))
    errors = [w.rmse_mm for w in shown]
    scale: dict[str, object] = {"rangemode": "tozero"}
    if max(errors) > _MANY_TIMES * max(limits):
        scale = log_axis(min(*errors, *limits), max(errors))
    return figure(
        traces,
        xaxis={
            "tickvals": [*range(len(shown))][every], "ticktext": names[every], "zeroline": False,
            "range": [-0.5, len(shown) - 0.5], "automargin": True,
        },
        yaxis={"title": "error at check poses, mm", "automargin": True, **scale},
        margin=(56, 14, 30, 34),
    )  # fmt: skip


def _said(w: ChangeReport) -> str:
    return escape("; ".join((f"{w.name} {w.date}".strip(), *change_phrases(w))))
