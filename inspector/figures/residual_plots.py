"""Figures of residuals: against an input, over the work space, and against the part that an effect would explain.

Numbers in, plotly figures out; style and labels are in `inspector.figures.style`. The selected pose is a trace of its
own, so that going from pose to pose changes that one (`select`) and draws nothing anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from calib.array_types import Array, IndexArray
from calib.html_text import escape
from calib.present.names import ROLES
from inspector.figures.robust_axis import beyond, robust_range
from inspector.figures.style import EDGE, SELECTED_COLOUR, SELECTS_POSE, SIGNED_SCALE, Part, figure, shortened
from inspector.markup.parts.colour_scale import ERROR
from inspector.markup.parts.palette import ROLE_COLOURS

SELECTED = "selected pose"
MEDIAN = "training median"
NOISE = "noise, 95 %"
_MEDIAN_COLOUR = "#CC79A7"
_SYMBOLS = {"train": "circle", "test": "diamond"}
_SIZES = tuple(zip(np.linspace(0.0, 1.0, len(ERROR)).tolist(), ERROR, strict=True))  # as in the 3D view


def residual_against(
    x: ArrayLike,
    y: ArrayLike,
    ids: Sequence[str],
    is_test: ArrayLike,
    *,
    x_title: str,
    y_title: str,
    band: tuple[float, float],
    smooth: tuple[ArrayLike, ArrayLike] | None = None,
    selected: str | None = None,
) -> go.Figure:
    """Figure of each pose's residual against one input, with the noise band; x, y, is_test (N,).

    `smooth` may have rows of nan: the line stops there. Single values between two (levels of an input) are dashes.
    """
    at, values = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    traces: list[Part] = []
    shapes: list[Part] = []
    if np.isfinite(band).all():
        shapes.append(
            {
                "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "y0": band[0], "y1": band[1], "layer": "below",
                "fillcolor": "rgba(138,143,152,0.22)", "line": {"width": 0},
            }
        )  # fmt: skip
        grey = {"size": 11, "symbol": "square", "color": "rgba(138,143,152,0.45)"}
        traces.append({"type": "scatter", "mode": "markers", "name": NOISE, "x": [None], "y": [None], "marker": grey})
    for role, rows in _roles(is_test):
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": ROLES[role], "x": at[rows].tolist(),
                "y": values[rows].tolist(), **_of_poses(ids, rows),
                "marker": {"size": 8, "color": ROLE_COLOURS[role], "symbol": _SYMBOLS[role]},
                "hovertemplate": f"pose %{{customdata}} ({ROLES[role]})<br>{escape(x_title)} %{{x:.5g}}<br>"
                f"{escape(y_title)} %{{y:.4g}}<extra></extra>",
            }
        )  # fmt: skip
    if smooth is not None and len(np.asarray(smooth[0])):
        traces.append(_line(np.asarray(smooth[0], dtype=float), np.asarray(smooth[1], dtype=float)))
    positive = bool(np.isfinite(values).any()) and float(np.nanmin(values)) >= 0.0
    robust = robust_range(values, from_zero=positive)
    extent: Part = {"rangemode": "tozero" if positive else "normal"}
    words: list[Part] = []
    if robust is not None:
        extent = {"range": [robust.low, robust.high]}
        unit = y_title.rpartition(", ")[2]
        edge, text = beyond(robust, at.tolist(), values, list(map(escape, ids)), escape(unit))
        traces, words = [*traces, edge], [text]
    fig = figure(
        [*traces, _ring()],
        xaxis={"title": escape(x_title), "automargin": True, "zeroline": False},
        yaxis={
            "title": escape(y_title), "automargin": True, "zeroline": True, **extent,
        },
        layout={"shapes": shapes, "annotations": words},
    )  # fmt: skip
    return select(fig, selected)


def _of_poses(ids: Sequence[str], rows: IndexArray) -> Part:
    """Trace keys with which hovering names a point's pose and a click selects it."""
    names = [escape(ids[i]) for i in rows]
    return {"customdata": names, "ids": names, "meta": SELECTS_POSE}


def _line(x: Array, y: Array) -> Part:
    known = np.isfinite(x)
    lone = known & ~np.append(known[1:], False) & ~np.insert(known[:-1], 0, False)
    return {
        "type": "scatter", "mode": "lines+markers", "name": MEDIAN, "x": _listed(x), "y": _listed(y),
        "connectgaps": False, "hoverinfo": "skip", "line": {"color": _MEDIAN_COLOUR, "width": 3},
        "marker": {
            "symbol": "line-ew", "size": np.where(lone, 26, 0).tolist(),
            "line": {"color": _MEDIAN_COLOUR, "width": np.where(lone, 3, 0).tolist()},
        },
    }  # fmt: skip


def place_views(
    place_mm: ArrayLike,
    values: ArrayLike,
    ids: Sequence[str],
    is_test: ArrayLike,
    *,
    title: str,
    signed: bool = False,
    selected: str | None = None,
) -> go.Figure:
    """Work space from above and from the side, each pose coloured by `values` (N,); `place_mm` (N, 3), base frame.

    `title` names the values with their unit. Signed values are coloured symmetrically about zero.
    """
    place, shown = np.asarray(place_mm, dtype=float), np.asarray(values, dtype=float)
    robust = robust_range(np.abs(shown), from_zero=True)
    usual = np.abs(shown if robust is None else shown[~robust.wild])
    largest = float(usual[np.isfinite(usual)].max(initial=0.0)) or 1.0
    scale_words = "" if robust is None else f"; {int(robust.wild.sum())} beyond, up to {robust.farthest:.3g}"
    colour: Part = {
        "cmin": -largest if signed else 0.0,
        "cmax": largest,
        "colorscale": SIGNED_SCALE if signed else _SIZES,
    }
    bar = {
        "title": {"text": escape(title + scale_words), "side": "right"}, "thickness": 10, "len": 0.9, "outlinewidth": 0,
        "tickfont": {"size": 10}, "xpad": 4,
    }  # fmt: skip
    traces: list[Part] = []
    for axis, letter in ((1, "y"), (2, "y2")):
        first = letter == "y"
        for role, rows in _roles(is_test):
            scale = {"colorbar": bar, "showscale": True} if not traces else {}
            traces.append(
                {
                    "type": "scatter", "mode": "markers", "name": ROLES[role], "legendgroup": role,
                    "showlegend": first, "yaxis": letter, "x": place[rows, 0].tolist(), "y": place[rows, axis].tolist(),
                    **_of_poses(ids, rows),
                    "text": [f"{v:.4g}" for v in shown[rows]],
                    "marker": {
                        **colour, **scale, "size": 9, "symbol": _SYMBOLS[role], "color": _listed(shown[rows]),
                        "line": {"color": EDGE, "width": 0.7},
                    },
                    "hovertemplate": f"pose %{{customdata}} ({ROLES[role]})<br>{escape(title)} %{{text}}<br>"
                    f"x %{{x:.0f}} mm, {'xyz'[axis]} %{{y:.0f}} mm<extra></extra>",
                }
            )  # fmt: skip
        traces.append(_ring(letter))
    return select(_two_views(traces), selected)


def places_by_role(place_mm: ArrayLike, ids: Sequence[str], roles: Sequence[str]) -> go.Figure:
    """Measured places from above and from the side, coloured by role; `place_mm` (N, 3), base frame."""
    place = np.asarray(place_mm, dtype=float)
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": ROLES[role], "legendgroup": role,
            "showlegend": letter == "y", "yaxis": letter, "x": place[rows, 0].tolist(), "y": place[rows, axis].tolist(),
            "customdata": [escape(ids[i]) for i in rows],
            "marker": {"size": 8, "color": ROLE_COLOURS[role], "symbol": _SYMBOLS.get(role, "square")},
            "hovertemplate": f"pose %{{customdata}} ({ROLES[role]})<br>x %{{x:.0f}} mm, "
            f"{'xyz'[axis]} %{{y:.0f}} mm<extra></extra>",
        }
        for axis, letter in ((1, "y"), (2, "y2"))
        for role in ROLE_COLOURS
        if (rows := [i for i, r in enumerate(roles) if r == role])
    ]  # fmt: skip
    return _two_views(traces)


def _two_views(traces: Sequence[Part]) -> go.Figure:
    """Figure of two panels of equal scale: from above (traces on axis "y") and from the side (traces on "y2")."""
    equal = {"scaleanchor": "x", "constrain": "domain"}
    return figure(
        traces,
        xaxis={"title": "x of the base, mm", "anchor": "y2", "constrain": "domain"},
        yaxis={"title": "y, mm (from above)", "domain": [0.53, 1.0], **equal},
        margin=(56, 10, 30, 42),
        layout={"yaxis2": {"title": "z, mm (from the side)", "domain": [0.0, 0.47], **equal}},
    )


def select(fig: go.Figure, pose_id: str | None) -> go.Figure:
    """Figure with the selection ring at another pose; without a ring where the pose is not among the points."""
    name = None if pose_id is None else escape(pose_id)
    points = [trace for trace in fig.data if trace.customdata is not None]
    for ring in fig.data:
        if ring.name != SELECTED:
            continue
        ring.x, ring.y = [None], [None]
        for trace in points:
            if trace.yaxis == ring.yaxis and name in trace.customdata:
                at = list(trace.customdata).index(name)
                ring.x, ring.y = [trace.x[at]], [trace.y[at]]
    return fig


def added_variable(explained: ArrayLike, residual: ArrayLike, name: str, ids: Sequence[str] = ()) -> go.Figure:
    """Added-variable plot of an effect: residual against the part that the effect explains, with the line of agreement.

    explained, residual  # (R,) in sigmas of the noise; ids: the pose of each of them
    """
    x, y = np.asarray(explained, dtype=float), np.asarray(residual, dtype=float)
    ends = [float(x.min(initial=0.0)), float(x.max(initial=0.0))]
    names = list(map(escape, ids))
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": "training points, per coordinate", "x": x.tolist(),
            "y": y.tolist(), "marker": {"size": 5, "color": ROLE_COLOURS["train"], "opacity": 0.8},
            "meta": {**SELECTS_POSE, "values": names}, "customdata": names,
            "hovertemplate": f"pose %{{customdata}}<br>{escape(name)} makes %{{x:.2f}} σ<br>"
            "residual %{y:.2f} σ<extra></extra>",
        },
        {
            "type": "scatter", "mode": "lines", "name": "agreement", "x": ends, "y": ends, "hoverinfo": "skip",
            "line": {"color": _MEDIAN_COLOUR, "width": 2},
        },
    ]  # fmt: skip
    return figure(
        traces,
        xaxis={"title": f"what {shortened(name, 30)} would make, σ of the noise", "automargin": True},
        yaxis={"title": "residual, σ of the noise", "automargin": True},
    )


def _roles(is_test: ArrayLike) -> list[tuple[str, IndexArray]]:
    test = np.asarray(is_test, dtype=bool)
    rows = (("train", np.flatnonzero(~test)), ("test", np.flatnonzero(test)))
    return [(role, at) for role, at in rows if len(at)]


def _ring(yaxis: str | None = None) -> Part:
    edge = SELECTED_COLOUR
    return {
        "type": "scatter", "mode": "markers", "name": SELECTED, "x": [None], "y": [None], "hoverinfo": "skip",
        "showlegend": False,
        "marker": {"size": 16, "symbol": "circle-open", "color": edge, "line": {"width": 2.5, "color": edge}},
        **({} if yaxis is None else {"yaxis": yaxis}),
    }  # fmt: skip


def _listed(values: Array) -> list[float | None]:
    """Values as a list, with None for NaN, where plotly interrupts a line."""
    return [float(v) if np.isfinite(v) else None for v in values]
