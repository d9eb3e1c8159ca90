"""A figure as an SVG file of its own."""

from __future__ import annotations

import plotly.graph_objects as go

from calib.errors import CalibError
from inspector.figures.svg.figure import svg_of


def svg_file(figure: go.Figure, width: int, height: int, *, title: str) -> str:
    """The figure as a file of its own, dark on white. Raises CalibError on one that cannot be drawn so."""
    if any(
        not isinstance((t.marker and t.marker.color) or "", str) for t in figure.data if t.type == "scatter"
    ):
        raise CalibError(
            f"{title}: plotly alone draws points in the colours of a scale; write_html keeps it as a page"
        )
    drawn = svg_of(figure, width, height, name="figure", title=title)
    style = (
        "<style>.plot{--ink:#1f2328;--soft:#59636e;--line:#d1d9e0;background:#fff;font-family:sans-serif}"
        ".plot text{fill:var(--ink)}.plot .grid{stroke:var(--line);fill:none}"
        ".plot .zero,.plot .ruler{stroke:var(--soft);fill:none}</style>"
    )
    start = drawn.index(">") + 1
    return drawn[:start].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ') + style + drawn[start:]
