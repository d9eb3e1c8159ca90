"""Common style of all figures: layout, colours of axes, names short enough for an axis.

Every figure fits a panel about 400 pixels wide, names its axes with units and shows values on hover. It is drawn once
for light and dark pages: its ground is transparent, its lines and marks stand out from both, and all its text has the
colour `INK`, in place of which the page puts its own (server/client/page.css).
"""

from __future__ import annotations

import math
import pickle
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.html_text import escape
from inspector.markup.parts.palette import HIGHLIGHT, MEASURE, ROLE_COLOURS

Part = dict[str, Any]  # of a figure as plotly takes it: a trace, an axis, a shape, an annotation

# Blue - white - red (ColorBrewer RdBu): safe for red-green blindness, symmetric in lightness about zero.
SIGNED_SCALE = ((0.0, "#2166AC"), (0.25, "#92C5DE"), (0.5, "#F7F7F7"), (0.75, "#F4A582"), (1.0, "#B2182B"))
# Of a trace whose points' `ids` are poses, escaped: a click on one selects it (server/client/plots.js). Where points
# share a pose, which ids may not, `values` in the trace's `meta` has a value for each point.
SELECTS_POSE = {"ask": "pose"}
NOWHERE = [math.nan]  # places of a trace that is in the legend alone
SHOWS_STEP = {"ask": "step"}  # the same of points whose `ids` are steps of the model


def selects_joint(joint: int) -> dict[str, object]:
    """Trace meta with which a click on any point of the trace selects a joint, counted from 1."""
    return {"ask": "joint", "value": joint}


INK = "#24292F"  # text on paper; saved figures keep it
VEIL = "rgba(255,255,255,0.75)"  # behind text that may lie over marks, on paper
EDGE = MEASURE  # outlines of points, marks of inputs
SELECTED_COLOUR = HIGHLIGHT  # ring of the selected pose, outline of the selected joint
_SYMBOLS = {"reference": "square", "train": "circle", "test": "diamond"}  # of poses by role
_GRID, _ZERO = "rgba(128,128,128,0.25)", "rgba(128,128,128,0.7)"


def shortened(name: str, most: int = 22) -> str:
    """Escaped name for an axis; one of more than `most` characters is cut in the middle: "transmi…error"."""
    if len(name) > most:
        end = (most - 1) // 2
        name = f"{name[: most - 1 - end]}…{name[-end:]}"
    return escape(name)


def log_axis(low: float, high: float) -> dict[str, object]:
    """Layout keys of a logarithmic axis over these values, with ticks at 0.1, 0.2, 0.5, 1 ..., 0.1, 1 ... of many."""
    steps = (1, 2, 5) if high < 1e3 * low else (1,)
    ticks = [float(f"{step}e{power}") for power in range(-7, 5) for step in steps]
    return {
        "type": "log", "tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks],
        "range": [math.log10(low / 1.3), math.log10(high * 1.3)],
    }  # fmt: skip


def listed(values: ArrayLike) -> list[Any]:
    """Values as a list, with None for NaN, where plotly interrupts a line."""
    return [None if isinstance(v, float) and math.isnan(v) else v for v in np.asarray(values).tolist()]


def scatter(
    name: str,
    x: ArrayLike,
    y: ArrayLike,
    *,
    marker: Part | None = None,
    line: Part | None = None,
    hover: str = "",
    more: Mapping[str, Any] | None = None,
) -> Part:
    """Trace of points, a line, or both, with what hovering shows ("" for nothing) and further keys."""
    drawn = {key: part for key, part in (("line", line), ("marker", marker)) if part is not None}
    told = {"hovertemplate": f"{hover}<extra></extra>"} if hover else {"hoverinfo": "skip"}
    mode = "+".join(f"{key}s" for key in drawn)
    return {
        "type": "scatter",
        "mode": mode,
        "name": name,
        "x": listed(x),
        "y": listed(y),
        **drawn,
        **told,
        **(more or {}),
    }


def agreement(values: Array, colour: str) -> Part:
    """Trace of the line on which two quantities are equal, over the range of `values`."""
    ends = [float(values.min(initial=0.0)), float(values.max(initial=0.0))]
    return scatter("agreement", ends, ends, line={"color": colour, "width": 2})


def of_poses(ids: Sequence[str], *, shared: bool = False) -> Part:
    """Trace keys with which hovering names a point's pose and a click selects it.

    shared: several points are of one pose.
    """
    names = list(map(escape, ids))
    return {"customdata": names} | (
        {"meta": {**SELECTS_POSE, "values": names}} if shared else {"ids": names, "meta": SELECTS_POSE}
    )


def of_role(role: str, size: float = 8) -> Part:
    """Marker of a pose by its role."""
    return {"size": size, "color": ROLE_COLOURS[role], "symbol": _SYMBOLS[role]}


def _key(traces: Sequence[Part], *axes: Part) -> str:
    """Key that differs between figures of different data, so that a zoom stays with its own figure.

    Viser keeps a zoom whatever is plotted next, unless an axis says that it is another.
    """
    numbers = [[trace.get(name) for name in "xyz"] for trace in traces]
    titles = [axis.get("title") for axis in axes]
    return f"{zlib.crc32(pickle.dumps((numbers, titles))):08x}"


def figure(
    traces: Sequence[Part],
    *,
    xaxis: Part | str,
    yaxis: Part | str,
    margin: tuple[int, int, int, int] = (56, 12, 30, 42),
    layout: Mapping[str, Any] | None = None,
) -> go.Figure:
    """Figure of traces in the common style; `margin`: left, right, top, bottom, px; `layout`: further keys.

    An axis is its title, or plotly's keys of it.

    Plotly's templates and its check of every value take fifty milliseconds a figure, which would be felt at each turn
    of a page; so there is no template, and the tests check the values.
    """
    both = [{"title": own} if isinstance(own, str) else own for own in (xaxis, yaxis)]
    axes = {
        "gridcolor": _GRID, "linecolor": _GRID, "zerolinecolor": _ZERO, "automargin": True,
        "uirevision": _key(traces, *both),
    }  # fmt: skip

    def axis(own: Part) -> Part:
        near = {"standoff": own["standoff"]} if "standoff" in own else {}  # pixels from the numbers to the title
        title = {"title": {"text": own["title"], **near}} if "title" in own else {}
        return {**axes, **{key: value for key, value in own.items() if key != "standoff"}, **title}

    more = {key: axis(value) if key.startswith(("xaxis", "yaxis")) else value for key, value in (layout or {}).items()}
    left, right, top, bottom = margin
    common = {
        "template": {"layout": {}},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "margin": {"l": left, "r": right, "t": top, "b": bottom},
        "font": {"size": 11, "color": INK},
        "legend": {"orientation": "h", "x": 0, "y": 1.02, "xanchor": "left", "yanchor": "bottom", "font": {"size": 11}},
        "hoverlabel": {"font": {"size": 12}},
        "dragmode": "zoom",
        "showlegend": True,
        **dict(zip(("xaxis", "yaxis"), map(axis, both), strict=True)),
    }  # fmt: skip
    return go.Figure({"data": list(traces), "layout": {**common, **more}}, _validate=False)
