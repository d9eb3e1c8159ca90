"""Charts of a watched cell: the error at check poses of each measurement, and the course of one change."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from calib.extras.watch.control_chart import date_of, in_time
from calib.extras.watch.courses import DRIFT
from calib.extras.watch.present.changes import average_label, change_phrases
from calib.extras.watch.series import SeriesReport
from calib.extras.watch.watch import ChangeReport
from calib.html_text import escape
from calib.rendering.numbers import readable
from inspector.figures.plots import NOISE_BAND
from inspector.figures.style import distinct_labels, figure, log_axis
from inspector.markup.parts.palette import BAD, DOUBT, GOOD, NEUTRAL

VERDICTS = {  # colour and marker, so that no verdict is told by its colour alone
    "unchanged": (GOOD, "circle"),
    "unclear": (DOUBT, "diamond"),
    "changed": (BAD, "square"),
}
_MANY_TIMES = 8.0  # the limit: from there on the axis is logarithmic


def control_chart(seen: Sequence[ChangeReport]) -> go.Figure:
    """Figure of each measurement's 3D RMSE in time order, with its expected value and limit for an unchanged cell."""
    shown = in_time(seen)
    x = list(range(1, len(shown) + 1))
    limits = [w.errors.limit_mm for w in shown]
    lines = (
        ("limit where nothing changed (99.7 %)", limits, "dash"),
        ("likely where nothing changed", [w.errors.likely_mm for w in shown], "dot"),
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
    dated = all(date_of(w.when) is not None for w in shown)
    names = [w.when[:10] for w in shown] if dated else distinct_labels([w.name for w in shown])
    step = -(-len(x) // 8)
    high = max(w.rmse_mm for w in shown)
    scale: dict[str, object] = {"rangemode": "tozero"}
    if high > _MANY_TIMES * max(limits):
        low = min(w.errors.likely_mm for w in shown)
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


def series_chart(found: SeriesReport) -> go.Figure:
    """Figure of one change's size at each check of a series, its moving average with the limit, and any drift found."""
    shown = found.shown
    assert shown is not None
    factor, unit = readable(1.0, shown.unit)
    times = found.times.tolist()
    limit = (factor * found.limit_z * shown.smoothed_sigmas).tolist()
    band = {"type": "scatter", "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    traces: list[dict[str, object]] = [
        {**band, "x": times, "y": [-value for value in limit], "showlegend": False},
        {
            **band, "x": times, "y": limit, "fill": "tonexty", "fillcolor": NOISE_BAND,
            "name": "limit of the moving average",
        },
        {
            "type": "scatter", "mode": "markers", "name": "each check, one sigma", "x": times,
            "y": (factor * shown.sizes).tolist(), "marker": {"size": 6, "color": NEUTRAL},
            "error_y": {"array": (factor * shown.sigmas).tolist(), "color": NEUTRAL, "thickness": 1, "width": 2},
            "customdata": [escape(f"{n} {w}".strip()) for n, w in zip(found.names, found.when, strict=True)],
            "hovertemplate": f"%{{customdata}}<br>%{{y:.3g}} {unit}<extra></extra>",
        },
        {
            "type": "scatter", "mode": "lines", "name": "moving average", "x": times,
            "y": (factor * shown.smoothed).tolist(), "line": {"color": GOOD, "width": 2}, "hoverinfo": "skip",
        },
    ]  # fmt: skip
    change = found.change
    if change is not None and found.course == DRIFT and shown.joint is not None:
        until = [0.0, times[-1]]
        traces.append(
            {
                "type": "scatter", "mode": "lines", "name": "drift", "x": until,
                "y": [factor * change.size * time for time in until],
                "line": {"color": BAD, "width": 1.5, "dash": "dash"}, "hoverinfo": "skip",
            }
        )  # fmt: skip
    return figure(
        traces,
        xaxis={"title": f"{found.time_unit}s since the calibration", "automargin": True, "zeroline": False},
        yaxis={"title": f"{average_label(shown)}, {unit}", "automargin": True},
        margin=(56, 14, 30, 40),
    )


def _said(w: ChangeReport) -> str:
    return escape("; ".join((f"{w.name} {w.when}".strip(), *change_phrases(w))))
