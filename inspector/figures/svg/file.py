"""SVG file of a figure."""

from __future__ import annotations

import zlib

import plotly.graph_objects as go

from calib.errors import CalibError
from inspector.figures.svg.figure import svg_of
from inspector.figures.svg.text import label

PAPER = "#ffffff"  # behind a figure that stands alone
_COLOURS = "--ink:#1f2328;--soft:#59636e;--line:#d1d9e0;background:#fff"
_HEADING_PX = 30
_IDS = "ids-of-this-picture"


def svg_file(figure: go.Figure, width: int, height: int, *, title: str, heading: str = "") -> str:
    """SVG file of a figure, on a light background.

    `title` is read aloud, `heading` stands over it. Raises CalibError on one that cannot be drawn so.
    """
    if any(not isinstance((t.marker and t.marker.color) or "", str) for t in figure.data if t.type == "scatter"):
        raise CalibError(f"{title}: plotly alone draws points in the colours of a scale; write_html keeps it as a page")
    above = _HEADING_PX if heading else 0
    drawn = svg_of(figure, width, height - above, name=_IDS, title=title)
    # A page may hold several: each has ids and colours of its own.
    drawn = drawn.replace(_IDS, f"picture{zlib.crc32(drawn.encode()):08x}")
    inner = drawn.replace("<svg ", f'<svg y="{above}" width="{width}" height="{height - above}" ', 1)
    style = (
        "<style>.picture text{fill:var(--ink)}.picture .faint{fill:var(--soft)}"
        ".picture .grid{stroke:var(--line);fill:none}"
        ".picture .zero,.picture .ruler{stroke:var(--soft);fill:none}</style>"
    )
    told = label(heading, 10.0, 0.55 * above, size_px=15.0, anchor="start") if heading else ""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="picture" viewBox="0 0 {width} {height}" '
        f'style="{_COLOURS};font-family:sans-serif;max-width:{width}px">{style}{told}{inner}</svg>'
    )
