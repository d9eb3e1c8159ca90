"""Figures of residuals: against an input, over the work space, against what is explained, and of two calibrations.

Numbers in, plotly figures out; style and labels are in `inspector.figures.style`. The selected pose is a trace of its
own, so that going from pose to pose changes that one (`select`) and draws nothing anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray, IndexArray
from calib.html_text import escape
from calib.present.names import ROLES
from inspector.figures.robust_axis import within_range
from inspector.figures.style import (
    NOWHERE,
    SELECTED_COLOUR,
    Part,
    agreement,
    figure,
    of_poses,
    of_role,
    scatter,
    shortened,
)
from inspector.markup.parts.palette import BESIDE_COLOURS, NEUTRAL, ROLE_COLOURS

SELECTED = "selected pose"
MEDIAN = "training median"
NOISE = "noise, 95 %"
_MEDIAN_COLOUR = "#CC79A7"


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
        traces.append(scatter(NOISE, NOWHERE, NOWHERE, marker=grey))
    values_told = f"{escape(x_title)} %{{x:.5g}}<br>{escape(y_title)} %{{y:.4g}}"
    for role, rows in _roles(is_test):
        hover = f"pose %{{customdata}} ({ROLES[role]})<br>{values_told}"
        of = of_poses([ids[i] for i in rows])
        traces.append(scatter(ROLES[role], at[rows], values[rows], marker=of_role(role), hover=hover, more=of))
    if smooth is not None and len(np.asarray(smooth[0])):
        traces.append(_line(np.asarray(smooth[0], dtype=float), np.asarray(smooth[1], dtype=float)))
    positive = bool(np.isfinite(values).any()) and float(np.nanmin(values)) >= 0.0
    unit = escape(y_title.rpartition(", ")[2])
    extent, edge, words = within_range(values, at.tolist(), list(map(escape, ids)), unit, from_zero=positive)
    fig = figure(
        [*traces, *edge, _ring()],
        xaxis={"title": escape(x_title), "zeroline": False},
        yaxis={"title": escape(y_title), "zeroline": True, **extent},
        layout={"shapes": shapes, "annotations": words},
    )
    return select(fig, selected)


def _line(x: Array, y: Array) -> Part:
    known = np.isfinite(x)
    lone = known & ~np.append(known[1:], False) & ~np.insert(known[:-1], 0, False)
    dashes = {
        "symbol": "line-ew", "size": np.where(lone, 26, 0).tolist(),
        "line": {"color": _MEDIAN_COLOUR, "width": np.where(lone, 3, 0).tolist()},
    }  # fmt: skip
    line = {"color": _MEDIAN_COLOUR, "width": 3}
    return scatter(MEDIAN, x, y, line=line, marker=dashes, more={"connectgaps": False})


def select(fig: go.Figure, pose_id: str | None) -> go.Figure:
    """Figure with the selection ring at another pose; without a ring where the pose is not among the points."""
    name = None if pose_id is None else escape(pose_id)
    points = [trace for trace in fig.data if trace.customdata is not None]
    for ring in fig.data:
        if ring.name != SELECTED:
            continue
        ring.x, ring.y = [None], [None]
        for trace in points:
            if name in trace.customdata:
                at = list(trace.customdata).index(name)
                ring.x, ring.y = [trace.x[at]], [trace.y[at]]
    return fig


def added_variable(explained: ArrayLike, residual: ArrayLike, name: str, ids: Sequence[str] = ()) -> go.Figure:
    """Added-variable plot of an effect: residual against the part that the effect explains, with the line of agreement.

    explained, residual  # (R,) in sigmas of the noise; ids: the pose of each of them
    """
    x = np.asarray(explained, dtype=float)
    hover = f"pose %{{customdata}}<br>{escape(name)} makes %{{x:.2f}} σ<br>residual %{{y:.2f}} σ"
    return figure(
        [_measured("training points, per coordinate", "train", x, residual, ids, hover), agreement(x, _MEDIAN_COLOUR)],
        xaxis=f"what {shortened(name, 30)} would make, σ of the noise",
        yaxis="residual, σ of the noise",
    )


def moved_by_change(moved_mm: Array, explained_mm: Array, ids: Sequence[str], held_out: BoolArray) -> go.Figure:
    """Figure of measured displacements (P, 3) against those that the proven causes explain, with the line of agreement.

    held_out: (P,) which pairs no fit saw.
    """
    hover = "pose %{customdata}<br>proven causes: %{x:.3f} mm<br>measured: %{y:.3f} mm"
    groups = {"fitted pairs, per coordinate": ("train", ~held_out), "held-out pairs": ("test", held_out)}
    traces = [
        _measured(
            name, role, explained_mm[of].ravel(), moved_mm[of].ravel(), np.repeat(np.array(ids)[of], 3).tolist(), hover
        )
        for name, (role, of) in groups.items()
        if of.any()
    ]
    return figure(
        [*traces, agreement(explained_mm, NEUTRAL)],
        xaxis="moved by the proven causes, mm",
        yaxis="moved by the change, measured, mm",
    )


def _measured(name: str, role: str, x: ArrayLike, y: ArrayLike, ids: Sequence[str], hover: str) -> Part:
    """Trace of what was measured, a point a coordinate, over what is explained of it."""
    marker = {"size": 5, "color": ROLE_COLOURS[role]}
    return scatter(name, x, y, marker=marker, hover=hover, more=of_poses(ids, shared=True))


def errors_beside(
    names: tuple[str, str],
    x: tuple[Array, Array],
    error_mm: tuple[Array, Array],
    ids: tuple[tuple[str, ...], tuple[str, ...]],
    *,
    x_title: str,
) -> go.Figure:
    """Figure of 3D errors (N,) and (M,) of two calibrations against an input; a click selects a pose of the first."""
    traces = []
    for k, colour in enumerate(BESIDE_COLOURS):
        of = of_poses(ids[k])
        marker = {"symbol": ("circle", "square-open")[k], "size": 8, "color": colour, "line": {"width": 1.5}}
        hover = f"{escape(names[k])}, pose %{{customdata}}<br>{escape(x_title)} %{{x:.5g}}<br>error %{{y:.4g}} mm"
        of = of if k == 0 else {"customdata": of["customdata"]}
        traces.append(scatter(shortened(names[k]), x[k], error_mm[k], marker=marker, hover=hover, more=of))
    return figure(
        traces,
        xaxis={"title": escape(x_title), "zeroline": False},
        yaxis={"title": "error, mm", "rangemode": "tozero"},
    )


def _roles(is_test: ArrayLike) -> list[tuple[str, IndexArray]]:
    test = np.asarray(is_test, dtype=bool)
    rows = (("train", np.flatnonzero(~test)), ("test", np.flatnonzero(test)))
    return [(role, at) for role, at in rows if len(at)]


def _ring() -> Part:
    ring = {"size": 16, "symbol": "circle-open", "color": SELECTED_COLOUR, "line": {"width": 2.5}}
    return scatter(SELECTED, NOWHERE, NOWHERE, marker=ring, more={"showlegend": False})
