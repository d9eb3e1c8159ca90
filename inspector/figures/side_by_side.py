"""Figure of the errors of two calibrations in one plot."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.array_types import Array
from calib.html_text import escape
from inspector.figures.style import SELECTS_POSE, figure, shortened
from inspector.markup.parts.palette import BESIDE_COLOURS

_SYMBOLS = ("circle", "square-open")


def errors_beside(
    names: tuple[str, str],
    x: tuple[Array, Array],
    error_mm: tuple[Array, Array],
    ids: tuple[tuple[str, ...], tuple[str, ...]],
    *,
    x_title: str,
    same_poses: bool,
) -> go.Figure:
    """Figure of 3D errors (N,) and (M,) of two calibrations against an input; a click selects a pose of the first.

    same_poses: both are of the same measurements, so that a click on either selects.
    """
    traces = []
    for k, (name, at, errors, pose_ids) in enumerate(zip(names, x, error_mm, ids, strict=True)):
        colour = BESIDE_COLOURS[k]
        selects = {"ids": [escape(i) for i in pose_ids], "meta": SELECTS_POSE} if k == 0 or same_poses else {}
        traces.append(
            {
                "type": "scatter", "mode": "markers", "name": shortened(name), "x": at.tolist(), "y": errors.tolist(),
                "customdata": [escape(i) for i in pose_ids], **selects,
                "marker": {"size": 8, "color": colour, "symbol": _SYMBOLS[k], "line": {"width": 1.5, "color": colour}},
                "hovertemplate": f"{escape(name)}, pose %{{customdata}}<br>{escape(x_title)} %{{x:.5g}}<br>"
                "error %{y:.4g} mm<extra></extra>",
            }
        )  # fmt: skip
    return figure(
        traces,
        xaxis={"title": escape(x_title), "automargin": True, "zeroline": False},
        yaxis={"title": "error, mm", "rangemode": "tozero", "automargin": True},
        margin=(50, 12, 30, 42),
    )
