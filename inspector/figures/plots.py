"""Figures of a fit: correlation of parameters, error per iteration, per pose and per change of the model.

Plain arrays in, plotly figures out; nothing is computed here. Style and labels are in `inspector.figures.style`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.html_text import escape
from calib.present.names import ROLES
from calib.rendering.numbers import parameter_label
from inspector.figures.robust_axis import beyond, robust_range
from inspector.figures.style import (
    INK,
    SELECTS_POSE,
    SHOWS_STEP,
    SIGNED_SCALE,
    Part,
    distinct_labels,
    figure,
    selects_joint_of_row,
    shortened,
)
from inspector.markup.parts.palette import ROLE_COLOURS, UNKNOWN, rgb, role_colour

MOST_TICKS = 16
MOST_DROPPING = 60  # test poses that are drawn one by one in a model's history
SPREAD = 0.3  # of the distance between two models: width over which single test poses are spread
NOISE_BAND = "rgba(128,128,128,0.28)"


def correlation_heatmap(
    names: Sequence[str],
    pearson: ArrayLike,
    *,
    no_influence: Sequence[str] = (),
    joints: Mapping[str, int] | None = None,
) -> go.Figure:
    """Heatmap of Pearson's r (P, P) of all pairs of parameters; grey (NaN) for parameters without influence.

    joints: the joint, from 1, of each parameter that belongs to one; a click on its row picks it.
    """
    r = np.asarray(pearson, dtype=float)
    labels = [escape(parameter_label(name)) for name in names]
    missing = np.isnan(r)
    picks = selects_joint_of_row({escape(parameter_label(n)): j for n, j in (joints or {}).items()})
    without = [name for name in names if name in set(no_influence)] or [
        name for i, name in enumerate(names) if missing[i].all()
    ]
    traces: list[Part] = []
    if missing.any():
        traces.append(
            {
                "type": "heatmap", "z": np.where(missing, 0.0, np.nan).tolist(), "x": labels, "y": labels,
                "showscale": False, "meta": picks, "xgap": 1, "ygap": 1, "zmin": -1, "zmax": 1,
                "colorscale": [(0, UNKNOWN), (1, UNKNOWN)],
                "hoverongaps": False, "customdata": _why_missing(names, without),
                "hovertemplate": "%{y} – %{x}<br>no influence: %{customdata}<extra></extra>",
            }
        )  # fmt: skip
    traces.append(
        {
            "type": "heatmap", "z": r.tolist(), "x": labels, "y": labels, "zmin": -1, "zmax": 1,
            "meta": picks,
            "colorscale": SIGNED_SCALE, "xgap": 1, "ygap": 1, "hoverongaps": False,
            "hovertemplate": "%{y} – %{x}<br>r = %{z:.4f}<extra></extra>",
            "colorbar": {
                "title": {"text": "r", "side": "top"}, "thickness": 8, "len": 0.75, "tickvals": [-1, -0.5, 0, 0.5, 1],
                "tickfont": {"size": 9}, "outlinewidth": 0, "xpad": 4,
            },
        }
    )  # fmt: skip
    size = 10 if len(names) <= 22 else 8 if len(names) <= 36 else 7
    axis = {
        "tickfont": {"size": size}, "showgrid": False, "zeroline": False, "ticks": "", "type": "category",
        "tickmode": "array", "tickvals": labels, "ticktext": labels, "constrain": "domain", "automargin": True,
    }  # fmt: skip
    return figure(
        traces,
        xaxis={**axis, "tickangle": -90, "title": "parameter"},
        yaxis={**axis, "autorange": "reversed", "scaleanchor": "x", "title": "parameter"},
        margin=(6, 6, 6, 6),
    )


def _why_missing(names: Sequence[str], no_influence: Sequence[str]) -> list[list[str]]:
    """Hover texts that name the parameter without influence in each pair."""
    without = set(no_influence)
    return [
        [
            " and ".join(dict.fromkeys(n for n in (row, column) if n in without)) or "a column does not vary"
            for column in names
        ]
        for row in names
    ]


def convergence(
    train_rmse_mm: Sequence[float], test_rmse_mm: Sequence[float] | None = None, *, what: str = "3D"
) -> go.Figure:
    """Figure of the error per iteration, logarithmic; iteration 0 is the nominal robot."""
    traces = []
    shown: list[float] = []
    longest = 1
    for role, values in (("train", train_rmse_mm), ("test", test_rmse_mm)):
        y = np.asarray(values if values is not None else [], dtype=float)
        if np.isnan(y).all():  # no poses of this role
            continue
        y = np.where(y > 0, y, np.nan)  # zero has no place on a logarithmic axis
        shown += y[np.isfinite(y)].tolist()
        longest = max(longest, len(y))
        traces.append(
            _curve(role, list(range(len(y))), y)
            | {"hovertemplate": f"iteration %{{x}}<br>{ROLES[role]} {what} RMSE %{{y:.4g}} mm<extra></extra>"}
        )
    return figure(
        traces,
        xaxis={"title": "iteration (0 = nominal)", "rangemode": "tozero", "dtick": max(1, longest // 8)},
        yaxis={"type": "log", "title": f"{what} RMSE, mm", "automargin": True, **_log_ticks(shown)},
    )


def _curve(role: str, x: list[int], y: Array) -> Part:
    return {
        "type": "scatter", "mode": "lines+markers", "name": ROLES[role], "x": x, "y": y.tolist(),
        "line": {"color": ROLE_COLOURS[role], "width": 2},
        "marker": {"size": 8, "symbol": "circle" if role == "train" else "diamond"}, "cliponaxis": False,
    }  # fmt: skip


def _log_ticks(values: Sequence[float]) -> Part:
    """Ticks 1, 2, 5, 10, ... over the values' range; only powers of ten where it is wide."""
    if not len(values):
        return {}
    low, high = np.floor(np.log10(min(values))), np.ceil(np.log10(max(values)))
    steps = (1,) if high - low > 3 else (1, 2, 5)
    every = max(1, int((high - low) // 8))
    ticks = [float(f"{s}e{int(e)}") for e in np.arange(low, high + 1, every) for s in steps]
    return {"tickvals": ticks, "ticktext": [f"{t:g}" for t in ticks]}


def pose_residuals(
    ids: Sequence[str],
    roles: Sequence[str],
    residual_mm: ArrayLike,
    *,
    selected: str | None = None,
    what: str = "residual",
) -> go.Figure:
    """Bars of each pose's residual (N,), mm, coloured by role, the selected pose outlined; NaN leaves a gap."""
    values = np.asarray(residual_mm, dtype=float)
    names = [escape(name) for name in ids]  # plotly reads a little markup in labels
    traces = []
    for role in sorted(set(roles), key=lambda r: list(ROLE_COLOURS).index(r) if r in ROLE_COLOURS else 99):
        at = [i for i, r in enumerate(roles) if r == role]
        word = ROLES.get(role, role)
        traces.append(
            {
                "type": "bar", "x": [names[i] for i in at], "y": values[at].tolist(), "name": word,
                "ids": [escape(ids[i]) for i in at], "meta": SELECTS_POSE,
                "marker": {"color": role_colour(role), "line": {"color": INK}},
                "hovertemplate": f"pose %{{x}} ({word})<br>{what} %{{y:.4f}} mm<extra></extra>",
            }
        )  # fmt: skip
    every = max(1, -(-len(names) // MOST_TICKS))
    robust = robust_range(values, from_zero=True)
    extent: Part = {"rangemode": "tozero"}
    words: list[Part] = []
    if robust is not None:
        extent = {"range": [robust.low, robust.high]}
        edge, text = beyond(robust, names, values, names, "mm")
        traces, words = [*traces, edge], [text]
    fig = figure(
        traces,
        xaxis={
            "title": "pose", "type": "category", "categoryorder": "array", "categoryarray": names,
            "tickvals": names[::every], "ticktext": distinct_labels(ids)[::every],
            "tickangle": -45, "tickfont": {"size": 9}, "automargin": True,
        },
        yaxis={"title": f"{what}, mm", "automargin": True, **extent},
        margin=(50, 12, 30, 46),
        layout={"bargap": 0.15, "barmode": "overlay", "annotations": words},
    )  # fmt: skip
    return outline(fig, selected)


def outline(fig: go.Figure, selected: str | None) -> go.Figure:
    """Bars of `pose_residuals` with another pose outlined."""
    name = None if selected is None else escape(selected)
    for bars in (trace for trace in fig.data if trace.type == "bar"):
        bars.marker.line.width = [2 if x == name else 0 for x in bars.x]
    return fig


def error_history(
    labels: Sequence[str],
    train_rmse_mm: ArrayLike,
    test_rmse_mm: ArrayLike,
    floor_mm: float | None,
    *,
    noise: str = "noise alone",
    test_poses_mm: Sequence[Mapping[str, float]] = (),
) -> go.Figure:
    """Figure of 3D RMSE after each change of the model, logarithmic, over the band of the noise; NaN leaves a gap.

    Args:
        labels: of the K models.
        train_rmse_mm: (K,) of the training poses.
        test_rmse_mm: (K,) of the test poses.
        floor_mm: 3D RMSE that noise alone leaves.
        noise: name of that noise.
        test_poses_mm: 3D error of each test pose by its id, for each model: a point, with a line from model to model.
    """
    steps = list(range(len(labels)))
    names = [escape(label) for label in labels]
    shown: list[float] = []
    traces: list[Part] = []
    if floor_mm is not None and len(labels):
        shown.append(floor_mm)
        traces += _noise_band(floor_mm, noise, len(labels), max(map(len, test_poses_mm), default=0))
    if any(map(len, test_poses_mm)):
        traces += _dropping(test_poses_mm)
        for errors in test_poses_mm:
            shown += np.percentile([mm for mm in errors.values() if mm > 0.0] or [1.0], (5, 100)).tolist()
    for role, values in (("train", train_rmse_mm), ("test", test_rmse_mm)):
        y = np.asarray(values, dtype=float)
        y = np.where(y > 0, y, np.nan)
        if not np.isfinite(y).any():
            continue
        shown += y[np.isfinite(y)].tolist()
        hover = "%{customdata}<br>" + ROLES[role] + " 3D RMSE %{y:.4g} mm<extra></extra>"
        traces.append(
            _curve(role, steps, y)
            | {"customdata": names, "hovertemplate": hover, "ids": list(map(str, steps)), "meta": SHOWS_STEP}
        )
    extent = {"range": [np.log10(min(shown) / 1.3), np.log10(max(shown) * 1.3)]} if shown else {}
    every = max(1, -(-len(labels) // MOST_TICKS))
    return figure(
        traces,
        xaxis={
            "tickvals": steps[::every], "ticktext": [shortened(label) for label in labels[::every]], "zeroline": False,
            "range": [-0.3, len(labels) - 0.7], "tickfont": {"size": 11}, "automargin": True,
            "tickangle": 0 if len(labels) < 3 else -25 if len(labels) < 9 else -60,
        },
        yaxis={"type": "log", "title": "3D RMSE, mm", "automargin": True, **_log_ticks(shown), **extent},
        margin=(56, 14, 30, 10),
    )  # fmt: skip


def _noise_band(floor_mm: float, noise: str, models: int, test_poses: int) -> list[Part]:
    """Band in which noise alone leaves the RMSE of the test poses, 95 %; a line where no test pose is given."""
    low, high = -0.3, models - 0.7
    hover = f"{noise}: {floor_mm:.4g} mm<extra></extra>"
    if not test_poses:
        line = {"color": UNKNOWN, "width": 2, "dash": "dash"}
        return [
            {
                "type": "scatter", "mode": "lines", "name": noise, "x": [low, high], "y": [floor_mm, floor_mm],
                "line": line, "hovertemplate": hover,
            }
        ]  # fmt: skip
    width = 2.0 / np.sqrt(6.0 * test_poses)  # two standard deviations of the RMS of three coordinates a pose
    line = {"width": 0.5, "color": UNKNOWN}
    ends = {"type": "scatter", "mode": "lines", "x": [low, high], "line": line, "hovertemplate": hover}
    bottom, top = floor_mm * max(1.0 - width, 0.1), floor_mm * (1.0 + width)
    return [
        {**ends, "y": [bottom, bottom], "showlegend": False, "name": noise},
        {**ends, "y": [top, top], "name": f"{noise}, 95 %", "fill": "tonexty", "fillcolor": NOISE_BAND},
    ]


def _dropping(test_poses_mm: Sequence[Mapping[str, float]]) -> list[Part]:
    """Traces of the single test poses: lines from model to model, and points that select their pose."""
    every = list(dict.fromkeys(pose for errors in test_poses_mm for pose in errors))
    ids = every[:: max(1, -(-len(every) // MOST_DROPPING))]
    name = "each test pose" if ids == every else f"{len(ids)} of {len(every)} test poses"
    offset = {pose: SPREAD * ((k * 0.618034) % 1.0 - 0.5) for k, pose in enumerate(ids)}
    x: list[float | None] = []
    y: list[float | None] = []
    of: list[str] = []
    for pose in ids:
        for step, errors in enumerate(test_poses_mm):
            mm = errors.get(pose, 0.0)
            x.append(step + offset[pose])
            y.append(mm if mm > 0.0 else None)
            of.append(pose)
        x.append(None)
        y.append(None)
        of.append(pose)
    colour = "rgba({},{},{},0.35)".format(*rgb(ROLE_COLOURS["test"]))
    names = [escape(pose) for pose in of]
    return [
        {
            "type": "scatter", "mode": "lines+markers", "name": name, "x": x, "y": y,
            "customdata": names, "meta": {**SELECTS_POSE, "values": names}, "connectgaps": False,
            "line": {"color": colour, "width": 0.6}, "marker": {"color": colour, "size": 4},
            "hovertemplate": "%{customdata}: %{y:.3g} mm<extra></extra>",
        }
    ]  # fmt: skip
