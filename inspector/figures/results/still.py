"""Figures as static pictures without a script."""

from __future__ import annotations

import plotly.graph_objects as go

from inspector.figures.svg.file import svg_file
from inspector.figures.svg.text import plain


def to_svg(figure: go.Figure, width_px: int = 850, height_px: int = 0) -> str:
    """A figure as the text of an SVG file without a script, its hover texts as titles.

    Args:
        height_px: 0 takes the figure's own.

    Raises CalibError on `work_space`: plotly alone draws points in the colours of a scale.
    """
    heading = plain(figure.layout.title.text or "")
    height = height_px or int(figure.layout.height or 360)
    return svg_file(figure, width_px, height, title=heading or "figure", heading=heading)
