"""One HTML page that stands alone: style, figures that can be hovered, and plotly.js itself are in it.

Opened from a file it asks no network (its own content policy forbids it), is light or dark as the reader's system is,
and prints light. What it looks like is in `templates/`, where jinja2 escapes every value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import plotly.graph_objects as go
from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from plotly.offline import get_plotlyjs

from inspector.report.blocks import Block, Figure, Section

MARK = '<meta name="generator" content="robot-calibration-inspector">'
"""Tells a report from any other file; among the first characters of the page."""


@dataclass(frozen=True)
class DrawnFigure:
    """A figure with its name in the page and both versions as JSON that cannot end the script it stands in."""

    kind: ClassVar[str] = "figure"  # the macro in templates/blocks.html
    name: str
    caption: str
    height_px: int
    width_px: int  # at the most
    light: str  # markup that needs no escape
    dark: str


def render_page(title: str, head: Sequence[Block], sections: Sequence[Section]) -> str:
    """The whole page: a head, then the sections."""
    figures: list[DrawnFigure] = []
    shown: list[dict[str, object]] = []
    for section in sections:
        blocks: list[Block | DrawnFigure] = []
        for block in section.blocks:
            if isinstance(block, Figure):
                figures.append(_drawn(block, f"figure{len(figures) + 1}"))
                blocks.append(figures[-1])
            else:
                blocks.append(block)
        shown.append({"heading": section.heading, "blocks": blocks})
    template = _templates().get_template("page.html")
    return template.render(
        mark=MARK, title=title, head=head, sections=shown, figures=figures, plotly_js=get_plotlyjs()
    )


@cache
def _templates() -> Environment:
    return Environment(
        loader=PackageLoader("inspector.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def _drawn(figure: Figure, name: str) -> DrawnFigure:
    light, dark = (
        htmlsafe_json_dumps(figure.draw(night), dumps=go.Figure.to_json) for night in (False, True)
    )
    return DrawnFigure(name, figure.caption, figure.height_px, figure.width_px, light, dark)
