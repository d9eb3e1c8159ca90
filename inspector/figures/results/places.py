"""Drawing of the figures that blocks of `calib.present` call for: SVG in the page's colours, without a script."""

from __future__ import annotations

from calib.rendering.blocks import FigurePlace
from inspector import figures
from inspector.figures.svg.figure import svg_of


def draw(place: FigurePlace, name: str) -> str:
    """SVG of the figure for a placeholder; `name` is the prefix of its ids."""
    drawn = getattr(figures, place.figure)(*place.of)
    height_px = place.height_px or int(drawn.layout.height)
    return svg_of(drawn, place.width_px, height_px, name=name, title=place.caption)
