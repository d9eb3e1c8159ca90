"""Self-contained figures: with a title and a background, and as a static picture where no script runs."""

from __future__ import annotations

import zlib

import plotly.graph_objects as go

from calib.html_text import escape
from inspector.figures.svg.figure import svg_of
from inspector.figures.svg.text import label, plain

PAPER = "#ffffff"  # behind a figure that stands alone
_TITLE_PX, _ALONE_PX, _HEADING_PX = 34, 420, 30  # what a title takes; the height of a figure that gives none
_COLOURS = "--ink:#1f2328;--soft:#59636e;--line:#d1d9e0;background:#fff"
_STYLE = (
    "<style>.picture text{fill:var(--ink)}.picture .faint{fill:var(--soft)}"
    ".picture .grid{stroke:var(--line);fill:none}"
    ".picture .zero,.picture .ruler{stroke:var(--soft);fill:none}</style>"
)
_IDS = "ids-of-this-picture"


def titled(fig: go.Figure, title: str, *, height_px: int = 0) -> go.Figure:
    """Figure with a title and its own background; `height_px` without the title, 0 for the default."""
    given = fig.to_dict()
    layout = given["layout"]
    alone = {
        "title": {
            "text": escape(title), "font": {"size": 15}, "x": 0, "xref": "paper", "y": 1, "yref": "container",
            "yanchor": "top", "pad": {"t": 10},
        },
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "margin": {**layout["margin"], "t": layout["margin"]["t"] + _TITLE_PX},
        "height": height_px + _TITLE_PX if height_px else _ALONE_PX,
    }  # fmt: skip
    return go.Figure({"data": given["data"], "layout": {**layout, **alone}}, _validate=False)


def to_svg(figure: go.Figure, width_px: int = 850, height_px: int = 0) -> str:
    """A figure as the text of an SVG file without a script, on a light background, its hover texts as titles.

    Args:
        height_px: 0 takes the figure's own.
    """
    heading = plain(figure.layout.title.text or "")
    height = height_px or int(figure.layout.height or 360)
    above = _HEADING_PX if heading else 0
    drawn = svg_of(figure, width_px, height - above, name=_IDS, title=heading or "figure")
    # A page may hold several: each has ids and colours of its own.
    drawn = drawn.replace(_IDS, f"picture{zlib.crc32(drawn.encode()):08x}")
    inner = drawn.replace("<svg ", f'<svg y="{above}" width="{width_px}" height="{height - above}" ', 1)
    told = label(heading, 10.0, 0.55 * above, size_px=15.0, anchor="start") if heading else ""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="picture" viewBox="0 0 {width_px} {height}" '
        f'style="{_COLOURS};font-family:sans-serif;max-width:{width_px}px">{_STYLE}{told}{inner}</svg>'
    )
