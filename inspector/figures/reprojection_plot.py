"""Figure of one image of a board: its corners, and arrows of the reprojection error."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from calib.calibration.reprojection import ReprojectedView
from inspector.figures.style import figure

_LONGEST_SHARE = 0.06  # of the image's width, of the longest arrow


def reprojected_corners(one: ReprojectedView, size_px: tuple[int, int]) -> go.Figure:
    """Corners as seen, with arrows from where the fit puts them, longer by a round factor that the title of x tells."""
    seen, off = one.view.pixels, one.error_px
    longest = max(float(np.linalg.norm(off, axis=1).max()), 1e-9)
    factor = 10.0 ** np.floor(np.log10(max(_LONGEST_SHARE * size_px[0] / longest, 1.0)))
    start = seen - factor * off
    lines_x: list[float | None] = []
    lines_y: list[float | None] = []
    for (x0, y0), (x1, y1) in zip(start.tolist(), seen.tolist(), strict=True):
        lines_x += [x0, x1, None]
        lines_y += [y0, y1, None]
    length = np.linalg.norm(off, axis=1)
    words = [f"corner {k}: {d:.3f} pixels" for k, d in zip(one.view.corner.tolist(), length.tolist(), strict=True)]
    traces = [
        {"type": "scatter", "mode": "lines", "x": lines_x, "y": lines_y, "line": {"width": 1.5, "color": "#C0392B"},
         "name": f"error × {factor:g}", "hoverinfo": "skip"},
        {"type": "scatter", "mode": "markers", "x": seen[:, 0].tolist(), "y": seen[:, 1].tolist(),
         "marker": {"size": 5, "color": "#1F77B4"}, "name": "corner", "text": words,
         "hovertemplate": "%{text}<extra></extra>"},
    ]  # fmt: skip
    return figure(
        traces,
        xaxis={"title": f"u, pixels; arrows × {factor:g}", "range": [0, size_px[0]]},
        yaxis={"title": "v, pixels", "range": [size_px[1], 0]},
        margin=(56, 16, 28, 44),
    )
