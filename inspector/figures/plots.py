"""Figures of fits: correlation of parameters, errors per iteration, pose, change of the model, number of poses.

Numbers in, plotly figures out; nothing is computed here. Style and labels are in `inspector.figures.style`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.html_text import escape
from calib.planning.plan import Plan
from calib.present.names import ROLES
from calib.rendering.numbers import parameter_label
from calib.validation.cross_validation import LearningCurve
from inspector.figures.robust_axis import within_range
from inspector.figures.style import (
    EDGE,
    INK,
    SELECTS_POSE,
    SHOWS_STEP,
    SIGNED_SCALE,
    Part,
    figure,
    log_axis,
    of_poses,
    of_role,
    scatter,
    shortened,
)
from inspector.markup.parts.palette import NEUTRAL, PROPOSAL, ROLE_COLOURS, UNKNOWN, rgb, role_colour

MOST_TICKS = 16
MOST_DROPPING = 60  # test poses that are drawn one by one in a model's history
SPREAD = 0.3  # of the distance between two models: width over which single test poses are spread
NOISE_BAND = "rgba(128,128,128,0.28)"


def correlation_heatmap(
    names: Sequence[str], pearson: ArrayLike, *, joints: Mapping[str, int] | None = None
) -> go.Figure:
    """Heatmap of Pearson's r (P, P) of all pairs of parameters; grey (NaN) for parameters without influence.

    joints: the joint, from 1, of each parameter that belongs to one; a click on its row picks it.
    """
    r = np.asarray(pearson, dtype=float)
    labels = [escape(parameter_label(name)) for name in names]
    missing = np.isnan(r)
    rows = {escape(parameter_label(name)): joint for name, joint in (joints or {}).items()}
    cells = {
        "type": "heatmap", "x": labels, "y": labels, "zmin": -1, "zmax": 1, "xgap": 1, "ygap": 1,
        "hoverongaps": False, "meta": {"ask": "joint", "rows": rows},
    }  # fmt: skip
    grey = {
        **cells, "z": np.where(missing, 0.0, np.nan).tolist(), "showscale": False,
        "colorscale": [(0, UNKNOWN), (1, UNKNOWN)],
        "hovertemplate": "%{y} – %{x}<br>no influence of one of both<extra></extra>",
    }  # fmt: skip
    coloured = {
        **cells, "z": r.tolist(), "colorscale": SIGNED_SCALE,
        "hovertemplate": "%{y} – %{x}<br>r = %{z:.4f}<extra></extra>",
        "colorbar": {
            "title": {"text": "r", "side": "top"}, "thickness": 8, "len": 0.75, "tickvals": [-1, -0.5, 0, 0.5, 1],
            "tickfont": {"size": 9}, "outlinewidth": 0, "xpad": 4,
        },
    }  # fmt: skip
    size = 10 if len(names) <= 22 else 8 if len(names) <= 36 else 7
    axis = {
        "tickfont": {"size": size}, "showgrid": False, "zeroline": False, "ticks": "", "type": "category",
        "tickmode": "array", "tickvals": labels, "ticktext": labels, "constrain": "domain",
    }  # fmt: skip
    return figure(
        [*([grey] if missing.any() else []), coloured],
        xaxis={**axis, "tickangle": -90, "title": "parameter"},
        yaxis={**axis, "autorange": "reversed", "scaleanchor": "x", "title": "parameter"},
        margin=(6, 6, 6, 6),
    )


def convergence(
    train_rmse_mm: Sequence[float], test_rmse_mm: Sequence[float] | None = None, *, what: str = "3D"
) -> go.Figure:
    """Figure of the error per iteration, logarithmic; iteration 0 is the nominal robot."""
    curves = _by_role(train_rmse_mm, test_rmse_mm)
    traces = [
        _curve(role, y, f"iteration %{{x}}<br>{ROLES[role]} {what} RMSE %{{y:.4g}} mm") for role, y in curves.items()
    ]
    longest = max((len(y) for y in curves.values()), default=1)
    return figure(
        traces,
        xaxis={"title": "iteration (0 = as delivered)", "rangemode": "tozero", "dtick": max(1, longest // 8)},
        yaxis={"title": f"{what} RMSE, mm", **_log_axis(_known(curves))},
    )


def _by_role(train_mm: ArrayLike, test_mm: ArrayLike | None) -> dict[str, Array]:
    """Errors by role, without roles that have none; NaN for zero, which has no place on a logarithmic axis."""
    of_roles = {"train": np.asarray(train_mm, dtype=float), "test": np.array(() if test_mm is None else test_mm, float)}
    return {role: np.where(y > 0.0, y, np.nan) for role, y in of_roles.items() if np.isfinite(y).any()}


def _known(curves: Mapping[str, Array]) -> list[float]:
    return [float(mm) for y in curves.values() for mm in y[np.isfinite(y)]]


def _log_axis(values: Sequence[float]) -> Part:
    return log_axis(min(values), max(values)) if values else {"type": "log"}


def _curve(role: str, y: ArrayLike, hover: str, more: Part | None = None, x: ArrayLike | None = None) -> Part:
    """Line with a point at each step, in the colour of a role."""
    steps = np.arange(len(np.asarray(y))) if x is None else x
    line, over_edge = {"color": ROLE_COLOURS[role], "width": 2}, {"cliponaxis": False, **(more or {})}
    return scatter(ROLES[role], steps, y, line=line, marker=of_role(role), hover=hover, more=over_edge)


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
                "ids": [names[i] for i in at], "meta": SELECTS_POSE,
                "marker": {"color": role_colour(role), "line": {"color": INK}},
                "hovertemplate": f"pose %{{x}} ({word})<br>{what} %{{y:.4f}} mm<extra></extra>",
            }
        )  # fmt: skip
    extent, edge, words = within_range(values, names, names, "mm", from_zero=True)
    every = max(1, -(-len(names) // MOST_TICKS))
    fig = figure(
        [*traces, *edge],
        xaxis={
            "title": "pose", "type": "category", "categoryorder": "array", "categoryarray": names,
            "tickvals": names[::every], "ticktext": [shortened(name, 12) for name in ids[::every]],
            "tickangle": -45, "tickfont": {"size": 9},
        },
        yaxis={"title": f"{what}, mm", **extent},
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
    names = [escape(label) for label in labels]
    curves = _by_role(train_rmse_mm, test_rmse_mm)
    shown = _known(curves)
    traces: list[Part] = []
    if floor_mm is not None and len(labels):
        shown.append(floor_mm)
        traces += _noise_band(floor_mm, noise, len(labels), max(map(len, test_poses_mm), default=0))
    if any(map(len, test_poses_mm)):
        traces.append(_dropping(test_poses_mm))
        for errors in test_poses_mm:
            shown += np.percentile([mm for mm in errors.values() if mm > 0.0] or [1.0], (5, 100)).tolist()
    steps = list(range(len(labels)))
    clicks = {"customdata": names, "ids": list(map(str, steps)), "meta": SHOWS_STEP}
    for role, y in curves.items():
        traces.append(_curve(role, y, f"%{{customdata}}<br>{ROLES[role]} 3D RMSE %{{y:.4g}} mm", clicks))
    every = max(1, -(-len(labels) // MOST_TICKS))
    return figure(
        traces,
        xaxis={
            "tickvals": steps[::every], "ticktext": [shortened(label) for label in labels[::every]], "zeroline": False,
            "range": [-0.3, len(labels) - 0.7], "tickfont": {"size": 11},
            "tickangle": 0 if len(labels) < 3 else -25 if len(labels) < 9 else -60,
        },
        yaxis={"title": "3D RMSE, mm", **_log_axis(shown)},
        margin=(56, 14, 30, 10),
    )  # fmt: skip


def _noise_band(floor_mm: float, noise: str, models: int, test_poses: int) -> list[Part]:
    """Band in which noise alone leaves the RMSE of the test poses, 95 %; a line where no test pose is given."""
    ends, hover = [-0.3, models - 0.7], f"{noise}: {floor_mm:.4g} mm"
    if not test_poses:
        dashed = {"color": UNKNOWN, "width": 2, "dash": "dash"}
        return [scatter(noise, ends, [floor_mm] * 2, line=dashed, hover=hover)]
    width = 2.0 / np.sqrt(6.0 * test_poses)  # two standard deviations of the RMS of three coordinates a pose
    line = {"width": 0.5, "color": UNKNOWN}
    bottom, top = floor_mm * max(1.0 - width, 0.1), floor_mm * (1.0 + width)
    fill = {"fill": "tonexty", "fillcolor": NOISE_BAND}
    return [
        scatter(noise, ends, [bottom] * 2, line=line, hover=hover, more={"showlegend": False}),
        scatter(f"{noise}, 95 %", ends, [top] * 2, line=line, hover=hover, more=fill),
    ]


def _dropping(test_poses_mm: Sequence[Mapping[str, float]]) -> Part:
    """Trace of the single test poses: lines from model to model, and points that select their pose."""
    every = list(dict.fromkeys(pose for errors in test_poses_mm for pose in errors))
    ids = every[:: max(1, -(-len(every) // MOST_DROPPING))]
    name = "each test pose" if ids == every else f"{len(ids)} of {len(every)} test poses"
    steps = len(test_poses_mm)
    y = np.full((len(ids), steps + 1), np.nan)  # the last interrupts the line
    for k, pose in enumerate(ids):
        y[k, :steps] = [errors.get(pose, np.nan) for errors in test_poses_mm]
    offset = SPREAD * ((np.arange(len(ids)) * 0.618034) % 1.0 - 0.5)
    x = offset[:, None] + np.append(np.arange(float(steps)), np.nan)
    colour = "rgba({},{},{},0.35)".format(*rgb(ROLE_COLOURS["test"]))
    return scatter(
        name, x.ravel(), np.where(y > 0.0, y, np.nan).ravel(), line={"color": colour, "width": 0.6},
        marker={"color": colour, "size": 4}, hover="%{customdata}: %{y:.3g} mm",
        more={**of_poses(np.repeat(ids, steps + 1).tolist(), shared=True), "connectgaps": False},
    )  # fmt: skip


def errors_by_poses(curve: LearningCurve) -> go.Figure:
    """Figure of training and held-out error against the number of fitted poses; bars: spread of the held-out error."""
    steps = curve.steps
    spread = {"type": "data", "array": [s.spread_mm for s in steps], "thickness": 1.2, "width": 4}
    of_roles = {
        "train": ("fitted poses", [s.train_rmse_mm for s in steps], {}),
        "test": ("held-out poses", [s.held_out_rmse_mm for s in steps], {"error_y": spread}),
    }
    poses = [s.poses for s in steps]
    traces = [
        _curve(role, y, f"%{{x}} poses<br>{name} %{{y:.4g}} mm", {"name": name, **more}, poses)
        for role, (name, y, more) in of_roles.items()
    ]
    return figure(
        traces,
        xaxis={"title": "poses fitted", "zeroline": False, "rangemode": "tozero"},
        yaxis={"title": "3D RMSE, mm", "rangemode": "tozero"},
    )


def error_by_count(plan: Plan) -> go.Figure:
    """Figure of the predicted error by number of new poses, with the planned number and the end of useful gains."""
    mm, planned = plan.curve_mm, len(plan.poses)
    inside = [k for k in range(len(mm)) if mm[k] < 1e3]
    traces = [
        scatter(
            "predicted error", inside, mm[inside], line={"width": 2, "color": PROPOSAL},
            marker={"size": 5, "color": PROPOSAL}, hover="%{x} new poses<br>%{y:.3g} mm",
        ),
        scatter(
            "this plan", [planned], mm[[planned]],
            marker={"size": 12, "color": PROPOSAL, "line": {"width": 2, "color": EDGE}},
            hover="this plan: %{x} poses<br>%{y:.3g} mm",
        ),
    ]  # fmt: skip
    if plan.enough is not None and plan.enough in inside:
        diamond = {"size": 11, "color": NEUTRAL, "symbol": "diamond"}
        hover = "from %{x} new poses on, five more lower it by less than 5 %"
        traces.append(
            scatter("from here more hardly pay", [plan.enough], mm[[plan.enough]], marker=diamond, hover=hover)
        )
    return figure(
        traces,
        xaxis={"title": "new poses", "zeroline": False},
        yaxis={"title": "predicted error, mm", "rangemode": "tozero"},
    )
