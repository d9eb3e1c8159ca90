"""Figure of learned curves: a panel for each, with the band of the fit's uncertainty and the measured inputs.

Fitted curves in, a plotly figure out; style and labels are in `inspector.figures.style`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from calib.array_types import BoolArray
from calib.html_text import escape
from calib.kinematics.robot import Robot
from calib.present.fit.learned import input_label
from calib.present.names import read_unit
from calib.screening.curves.fitted_curves import FittedCurve
from inspector.figures.style import EDGE, NOWHERE, Part, figure, listed, scatter, selects_joint
from inspector.markup.parts.palette import NEUTRAL

CURVE, BAND, OUTSIDE, MEASURED = "fitted curve", "± 2 sigma", "not measured", "training poses"
_TOP_PX, _PLOT_PX, _GAP_PX, _BOTTOM_PX = (56, 116, 68, 44)  # legend and first title; a panel; between two; last axis
_GREY = "rgba(138,143,152,0.22)"
_CURVE_COLOUR, _BAND_COLOUR = "#1F86C9", "rgba(31,134,201,0.28)"
_BEYOND = 0.5  # of the inside's height that the outside may add to the axis on either side


def height_px(panels: int, columns: int = 1) -> int:
    """Height of the figure of a number of curves, px."""
    rows = -(-panels // columns)
    return _TOP_PX + rows * _PLOT_PX + (rows - 1) * _GAP_PX + _BOTTOM_PX


def joint_curves(curves: Sequence[FittedCurve], robot: Robot, *, columns: int = 1) -> go.Figure:
    """Figure of each curve's error over its input, one panel each, in `columns` columns."""
    rows = -(-len(curves) // columns)
    inner_px = height_px(len(curves), columns) - _TOP_PX - _BOTTOM_PX
    traces: list[Part] = []
    layout: Part = {}
    shapes: list[Part] = []
    titles: list[Part] = []
    for k, curve in enumerate(curves):
        name = "" if k == 0 else str(k + 1)
        row, column = divmod(k, columns)
        top = 1.0 - row * (_PLOT_PX + _GAP_PX) / inner_px
        bottom = 0.0 if row == rows - 1 else top - _PLOT_PX / inner_px
        width = (1.0 - 0.12 * (columns - 1)) / columns
        left = column * (width + 0.12)
        x, low, high = curve.input_scale * curve.u, *_range(curve)
        traces += _traces(curve, f"x{name}", f"y{name}", low + 0.05 * (high - low), first=k == 0)
        shapes += _unmeasured(curve, f"x{name}", f"y{name}")
        titles.append(
            {
                "text": f"<b>Joint {curve.joint + 1}</b>", "name": str(curve.joint + 1), "captureevents": True,
                "xref": f"x{name} domain", "yref": f"y{name} domain",
                "x": 0.0, "y": 1.0, "xanchor": "left", "yanchor": "bottom", "showarrow": False, "yshift": 1,
                "font": {"size": 12},
            }
        )  # fmt: skip
        layout[f"xaxis{name}"] = {
            "title": escape(input_label(curve, robot)), "domain": [left, left + width], "anchor": f"y{name}",
            "range": [float(x[0]), float(x[-1])], "zeroline": False, "nticks": 8, "standoff": 6,
            "automargin": False,
        }  # fmt: skip
        layout[f"yaxis{name}"] = {
            "title": f"error, {curve.unit}", "domain": [bottom, top], "anchor": f"x{name}",
            "range": [low, high], "zeroline": True, "nticks": 5, "automargin": False,
        }  # fmt: skip
    legend = {
        "orientation": "h", "x": 0, "xanchor": "left", "y": 1.0 + 22.0 / inner_px, "yanchor": "bottom",
        "font": {"size": 11},
    }  # fmt: skip
    return figure(
        traces,
        xaxis=layout.pop("xaxis"),
        yaxis=layout.pop("yaxis"),
        margin=(54, 10, _TOP_PX, _BOTTOM_PX),
        layout={**layout, "shapes": shapes, "annotations": titles, "legend": legend},
    )


def _range(curve: FittedCurve) -> tuple[float, float]:
    """Range of the error axis: all of the measured range, and as much of the unmeasured part as stays readable."""
    value, half = curve.scale * curve.value, 2.0 * curve.scale * curve.sigma
    inside = curve.inside
    low, high = float((value - half)[inside].min()), float((value + half)[inside].max())
    tall = max(high - low, 1e-9)
    low = max(float((value - half).min()), low - _BEYOND * tall)
    high = min(float((value + half).max()), high + _BEYOND * tall)
    pad = 0.1 * (high - low)
    return min(low, 0.0) - 1.8 * pad, max(high, 0.0) + pad  # the inputs are marked at the bottom


def _traces(curve: FittedCurve, xaxis: str, yaxis: str, rug: float, *, first: bool) -> list[Part]:
    """Traces of one curve; `rug` is the error at which the measured inputs are marked."""
    x, y, half = curve.input_scale * curve.u, curve.scale * curve.value, 2.0 * curve.scale * curve.sigma
    axes = {"xaxis": xaxis, "yaxis": yaxis, "showlegend": first, "meta": selects_joint(curve.joint + 1)}
    unseen = {**axes, "showlegend": False}
    told = {"connectgaps": False, "customdata": listed(half)}
    edge = {"color": "rgba(0,0,0,0)", "width": 0}
    fill = {"legendgroup": BAND, "fill": "tonexty", "fillcolor": _BAND_COLOUR}
    ticks = {"symbol": "line-ns", "size": 7, "line": {"color": EDGE, "width": 1}}
    hover = (
        f"joint {curve.joint + 1}: %{{y:.3g}} ± %{{customdata:.2g}} {curve.unit}<br>at %{{x:.4g}} "
        f"{read_unit(curve.input_unit)}"
    )
    outside, inside = np.where(_closed(~curve.inside), y, np.nan), np.where(curve.inside, y, np.nan)
    rugs = np.full(len(curve.measured), rug)
    return [
        scatter("upper", x, y + half, line=edge, more=unseen),
        scatter(BAND, x, y - half, line=edge, more={**axes, **fill}),
        scatter("outside", x, outside, line={"color": NEUTRAL, "width": 1.5}, hover=hover, more={**unseen, **told}),
        scatter(
            CURVE, x, inside, line={"color": _CURVE_COLOUR, "width": 2}, hover=hover,
            more={**axes, **told, "legendgroup": CURVE},
        ),
        scatter(
            MEASURED, curve.input_scale * curve.measured, rugs, marker=ticks,
            more={**axes, "legendgroup": MEASURED},
        ),
        scatter(OUTSIDE, NOWHERE, NOWHERE, marker={"size": 11, "symbol": "square", "color": _GREY}, more=axes),
    ]  # fmt: skip


def _unmeasured(curve: FittedCurve, xaxis: str, yaxis: str) -> list[Part]:
    """Grey rectangles on either side of the measured range."""
    u, first, last = (curve.input_scale * v for v in (curve.u, curve.measured[:1], curve.measured[-1:]))
    grey = {"y0": 0, "y1": 1, "layer": "below", "fillcolor": _GREY, "line": {"width": 0}}
    return [
        {"type": "rect", "xref": xaxis, "yref": f"{yaxis} domain", "x0": float(x0), "x1": float(x1), **grey}
        for x0, x1 in ((u[0], first[0]), (last[0], u[-1]))
    ]


def _closed(outside: BoolArray) -> BoolArray:
    """Mask of places outside the measured range, widened by one place on each side so that the drawn parts meet."""
    return outside | np.append(outside[1:], False) | np.insert(outside[:-1], 0, False)
