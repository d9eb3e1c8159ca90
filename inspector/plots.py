"""Figures from numbers: plain arrays in, plotly figures out. Nothing here knows viser or computes anything.

Every figure fits a panel about 400 pixels wide, names its axes with units, shows values on hover, and comes in a light
and a dark version, because a plotly figure does not follow the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
import plotly.graph_objects as go
from numpy.typing import ArrayLike, NDArray

from inspector.palette import ROLE_COLOURS, ROLE_WORDS, role_colour

# Blue - white - red (ColorBrewer RdBu): safe for red-green blindness, symmetric in lightness about zero.
CORRELATION_SCALE = (
    (0.0, "#2166AC"),
    (0.25, "#92C5DE"),
    (0.5, "#F7F7F7"),
    (0.75, "#F4A582"),
    (1.0, "#B2182B"),
)
NO_INFLUENCE = "#8A8F98"
_GREEK = {"alpha": "α", "beta": "β", "theta": "θ"}


def parameter_label(name: str) -> str:
    """ "alpha3" -> "α3", "aTCP" -> "aTCP": short enough for an axis."""
    for word, letter in _GREEK.items():
        if name.startswith(word):
            return letter + escape(name[len(word) :])
    return escape(name)


def correlation_heatmap(
    names: Sequence[str], pearson: ArrayLike, *, dark: bool = False, no_influence: Sequence[str] = ()
) -> go.Figure:
    """Pearson's r of all pairs. pearson  # (P, P); NaN where a parameter has no influence: those cells are grey."""
    r = np.asarray(pearson, dtype=float)
    labels = [parameter_label(name) for name in names]
    missing = np.isnan(r)
    silent = [name for name in names if name in set(no_influence)] or [
        name for i, name in enumerate(names) if missing[i].all()
    ]
    fig = go.Figure()
    if missing.any():
        fig.add_trace(
            go.Heatmap(
                z=np.where(missing, 0.0, np.nan), x=labels, y=labels, showscale=False, xgap=1, ygap=1,
                colorscale=[(0, NO_INFLUENCE), (1, NO_INFLUENCE)], zmin=-1, zmax=1, hoverongaps=False,
                customdata=_why_missing(names, silent),
                hovertemplate="%{y} – %{x}<br>no influence: %{customdata}<extra></extra>",
            )
        )  # fmt: skip
    fig.add_trace(
        go.Heatmap(
            z=r, x=labels, y=labels, zmin=-1, zmax=1, colorscale=CORRELATION_SCALE, xgap=1, ygap=1,
            hoverongaps=False, hovertemplate="%{y} – %{x}<br>r = %{z:.4f}<extra></extra>",
            colorbar={
                "title": {"text": "r", "side": "top"}, "thickness": 8, "len": 0.75, "tickvals": [-1, -0.5, 0, 0.5, 1],
                "tickfont": {"size": 9}, "outlinewidth": 0, "xpad": 4,
            },
        )
    )  # fmt: skip
    size = 10 if len(names) <= 22 else 8 if len(names) <= 36 else 7
    axis = {
        "tickfont": {"size": size}, "showgrid": False, "zeroline": False, "ticks": "", "type": "category",
        "tickmode": "array", "tickvals": labels, "ticktext": labels, "constrain": "domain",
    }  # fmt: skip
    fig.update_xaxes(**axis, tickangle=-90)
    fig.update_yaxes(**axis, autorange="reversed", scaleanchor="x")
    _style(fig, dark, margin={"l": 6, "r": 6, "t": 6, "b": 6})
    fig.update_xaxes(automargin=True)
    fig.update_yaxes(automargin=True)
    return fig


def _why_missing(names: Sequence[str], silent: Sequence[str]) -> NDArray:
    quiet = set(silent)
    words = [
        [
            " and ".join(dict.fromkeys(n for n in (row, column) if n in quiet)) or "a column does not vary"
            for column in names
        ]
        for row in names
    ]
    return np.array(words, dtype=object)


def convergence(
    train_rmse_mm: Sequence[float],
    test_rmse_mm: Sequence[float] | None = None,
    *,
    what: str = "3D",
    dark: bool = False,
) -> go.Figure:
    """Error per iteration, logarithmic; iteration 0 is the nominal robot."""
    fig = go.Figure()
    for role, values in (("train", train_rmse_mm), ("test", test_rmse_mm)):
        if values is None or not len(values):
            continue
        y = np.asarray(values, dtype=float)
        if np.isnan(y).all():  # no poses of this role
            continue
        fig.add_trace(
            go.Scatter(
                x=np.arange(len(y)),
                y=np.where(y > 0, y, np.nan),  # zero has no place on a logarithmic axis
                mode="lines+markers",
                name=ROLE_WORDS[role],
                line={"color": ROLE_COLOURS[role], "width": 2},
                marker={"size": 7, "symbol": "circle" if role == "train" else "diamond"},
                hovertemplate="iteration %{x}<br>"
                + ROLE_WORDS[role]
                + f" {what} RMSE %{{y:.4g}} mm<extra></extra>",
            )
        )
    _style(fig, dark, margin={"l": 56, "r": 12, "t": 30, "b": 42})
    ticks = _log_ticks([v for trace in fig.data for v in trace.y if np.isfinite(v)])
    fig.update_yaxes(
        type="log",
        title=f"{what} RMSE, mm",
        automargin=True,
        tickvals=ticks,
        ticktext=[f"{t:g}" for t in ticks],
    )
    fig.update_xaxes(title="iteration (0 = nominal)", rangemode="tozero", dtick=_whole_steps(fig))
    return fig


def _log_ticks(values: Sequence[float]) -> list[float]:
    """1, 2, 5, 10, ... over the values' range; only powers of ten where that is wide."""
    if not len(values):
        return []
    low, high = np.floor(np.log10(min(values))), np.ceil(np.log10(max(values)))
    steps = (1,) if high - low > 3 else (1, 2, 5)
    every = max(1, int((high - low) // 8))
    return [float(f"{s}e{int(e)}") for e in np.arange(low, high + 1, every) for s in steps]


def _whole_steps(fig: go.Figure) -> int:
    longest = max((len(trace.x) for trace in fig.data), default=1)
    return max(1, longest // 8)


def pose_residuals(
    ids: Sequence[str],
    roles: Sequence[str],
    residual_mm: ArrayLike,
    *,
    selected: str | None = None,
    what: str = "residual",
    dark: bool = False,
) -> go.Figure:
    """One bar a pose, coloured by role, the selected pose outlined. residual_mm  # (N,); NaN leaves a gap."""
    values = np.asarray(residual_mm, dtype=float)
    names = [escape(name) for name in ids]  # plotly reads a little markup in labels
    fig = go.Figure()
    for role in sorted(set(roles), key=lambda r: list(ROLE_COLOURS).index(r) if r in ROLE_COLOURS else 99):
        at = [i for i, r in enumerate(roles) if r == role]
        fig.add_trace(
            go.Bar(
                x=[names[i] for i in at],
                y=values[at],
                name=ROLE_WORDS.get(role, role),
                marker={
                    "color": role_colour(role),
                    "line": {
                        "color": "#FFFFFF" if dark else "#111111",
                        "width": [2 if ids[i] == selected else 0 for i in at],
                    },
                },
                hovertemplate=f"pose %{{x}} ({ROLE_WORDS.get(role, role)})<br>{what} %{{y:.4f}} mm<extra></extra>",
            )
        )
    _style(fig, dark, margin={"l": 50, "r": 12, "t": 30, "b": 46})
    fig.update_layout(bargap=0.15, barmode="overlay")
    fig.update_xaxes(
        title="pose", type="category", categoryorder="array", categoryarray=names, nticks=12, tickangle=-45,
        tickfont={"size": 9}, automargin=True,
    )  # fmt: skip
    fig.update_yaxes(title=f"{what}, mm", rangemode="tozero", automargin=True)
    return fig


def error_history(
    labels: Sequence[str],
    train_rmse_mm: ArrayLike,
    test_rmse_mm: ArrayLike,
    floor_mm: float | None,
    *,
    dark: bool = False,
) -> go.Figure:
    """3D RMSE after each change of the model, logarithmic, with the noise as a line. NaN leaves a gap."""
    fig = go.Figure()
    steps = np.arange(len(labels))
    names = [escape(label) for label in labels]
    shown: list[float] = []
    for role, values in (("train", train_rmse_mm), ("test", test_rmse_mm)):
        y = np.asarray(values, dtype=float)
        y = np.where(y > 0, y, np.nan)
        if not np.isfinite(y).any():
            continue
        shown += y[np.isfinite(y)].tolist()
        fig.add_trace(
            go.Scatter(
                x=steps.tolist(), y=y.tolist(), customdata=names, mode="lines+markers", name=ROLE_WORDS[role],
                line={"color": ROLE_COLOURS[role], "width": 2},
                marker={"size": 8, "symbol": "circle" if role == "train" else "diamond"},
                hovertemplate="%{customdata}<br>" + ROLE_WORDS[role] + " 3D RMSE %{y:.4g} mm<extra></extra>",
            )
        )  # fmt: skip
    if floor_mm is not None and len(labels):
        shown.append(floor_mm)
        fig.add_trace(
            go.Scatter(
                x=[-0.3, len(labels) - 0.7], y=[floor_mm, floor_mm], mode="lines", name="noise alone",
                line={"color": "#8A8F98", "width": 2, "dash": "dash"},
                hovertemplate=f"noise alone: {floor_mm:.4g} mm<extra></extra>",
            )
        )  # fmt: skip
    _style(fig, dark, margin={"l": 56, "r": 14, "t": 30, "b": 10})
    ticks = _log_ticks(shown)
    fig.update_yaxes(
        type="log", title="3D RMSE, mm", automargin=True, tickvals=ticks, ticktext=[f"{t:g}" for t in ticks]
    )
    if shown:
        fig.update_yaxes(range=[np.log10(min(shown) / 1.3), np.log10(max(shown) * 1.3)])
    fig.update_xaxes(
        tickvals=steps.tolist(), ticktext=names, zeroline=False, range=[-0.3, len(labels) - 0.7], tickfont={"size": 10},
        tickangle=-25 if len(labels) > 2 else 0, automargin=True,
    )  # fmt: skip
    return fig


def added_variable(explained: ArrayLike, residual: ArrayLike, name: str, *, dark: bool = False) -> go.Figure:
    """What is left over against what an effect makes of it, in noise sigmas, with the line on which they agree. (R,)"""
    x, y = np.asarray(explained, dtype=float), np.asarray(residual, dtype=float)
    fig = go.Figure()
    fig.add_trace(
        go.Scatter(
            x=x.tolist(), y=y.tolist(), mode="markers", name="a coordinate of a training point",
            marker={"size": 5, "color": ROLE_COLOURS["train"], "opacity": 0.8},
            hovertemplate=f"{escape(name)} makes %{{x:.2f}} σ<br>left over %{{y:.2f}} σ<extra></extra>",
        )
    )  # fmt: skip
    ends = [float(x.min(initial=0.0)), float(x.max(initial=0.0))]
    fig.add_trace(
        go.Scatter(
            x=ends, y=ends, mode="lines", name="agreement", line={"color": "#CC79A7", "width": 2}, hoverinfo="skip"
        )
    )  # fmt: skip
    _style(fig, dark, margin={"l": 56, "r": 12, "t": 30, "b": 42})
    fig.update_xaxes(title=f"what {escape(name)} would make, σ", automargin=True)
    fig.update_yaxes(title="left over, σ", automargin=True)
    return fig


def residual_against(
    x: ArrayLike,
    y: ArrayLike,
    ids: Sequence[str],
    *,
    x_title: str,
    y_title: str,
    band: tuple[float, float],
    smooth: tuple[ArrayLike, ArrayLike] | None = None,
    selected: str | None = None,
    dark: bool = False,
) -> go.Figure:
    """What is left at each pose against one input, the noise band behind it. x, y  # (N,), NaN y is left out."""
    at, values = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    names = [escape(name) for name in ids]
    fig = go.Figure()
    if np.isfinite(band).all():
        fig.add_hrect(y0=band[0], y1=band[1], fillcolor="rgba(138,143,152,0.22)", line_width=0, layer="below")
        fig.add_trace(
            go.Scatter(
                x=[None], y=[None], mode="markers", name="noise, 95 %",
                marker={"size": 11, "symbol": "square", "color": "rgba(138,143,152,0.45)"},
            )
        )  # fmt: skip
    fig.add_trace(
        go.Scatter(
            x=at.tolist(), y=values.tolist(), customdata=names, mode="markers", name=ROLE_WORDS["train"],
            marker={
                "size": [12 if name == selected else 7 for name in ids], "color": ROLE_COLOURS["train"],
                "line": {
                    "color": "#FFFFFF" if dark else "#111111",
                    "width": [2.5 if name == selected else 0 for name in ids],
                },
            },
            hovertemplate=f"pose %{{customdata}}<br>{escape(x_title)} %{{x:.5g}}<br>"
            + f"{escape(y_title)} %{{y:.4g}}<extra></extra>",
        )
    )  # fmt: skip
    if smooth is not None:
        fig.add_trace(
            go.Scatter(
                x=np.asarray(smooth[0], dtype=float).tolist(), y=np.asarray(smooth[1], dtype=float).tolist(),
                mode="lines", name="running median", line={"color": "#CC79A7", "width": 3}, hoverinfo="skip",
            )
        )  # fmt: skip
    _style(fig, dark, margin={"l": 56, "r": 12, "t": 30, "b": 42})
    fig.update_xaxes(title=escape(x_title), automargin=True)
    fig.update_yaxes(title=escape(y_title), automargin=True, zeroline=True)
    return fig


def _style(fig: go.Figure, dark: bool, margin: dict[str, int]) -> None:
    text = "#E8EAED" if dark else "#24292F"
    grid = "rgba(255,255,255,0.14)" if dark else "rgba(0,0,0,0.10)"
    fig.update_layout(
        template="plotly_dark" if dark else "plotly_white",
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        margin=margin,
        font={"size": 11, "color": text},
        legend={
            "orientation": "h",
            "x": 0,
            "y": 1.02,
            "xanchor": "left",
            "yanchor": "bottom",
            "font": {"size": 11},
        },
        hoverlabel={"font": {"size": 12}},
        dragmode=False,
        showlegend=True,
    )
    fig.update_xaxes(gridcolor=grid, linecolor=grid)
    fig.update_yaxes(gridcolor=grid, linecolor=grid)
