"""Self-contained HTML page: text, tables, and figures as SVG, without scripts or network access.

It is light or dark as the reader's system is, and prints light, the first page for the customer. What it looks like is
in `templates/`, where jinja2 escapes every value.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import count

from jinja2 import Environment, PackageLoader

from calib.present.blocks import Block, Presentation, Section
from calib.present.html import drawn, environment
from inspector.figures.results.places import draw
from inspector.report.figure_block import still

MARK = '<meta name="generator" content="robot-calibration-inspector">'
"""Tells a report from any other file; among the first characters of the page."""


def render(told: Presentation) -> str:
    """HTML page of a presentation, with its figures."""
    names = (f"figure{number}" for number in count(1))
    return _templates().get_template("page.html").render(mark=MARK, title=told.title, **drawn(told, draw, names))


def render_page(title: str, head: Sequence[Block], sections: Sequence[Section]) -> str:
    """HTML of a whole page: a head, which is the first page on paper, then the sections."""
    names = (f"figure{number}" for number in count(1))

    shown = [{"heading": section.heading, "blocks": still(section.blocks, names)} for section in sections]
    template = _templates().get_template("page.html")
    return template.render(mark=MARK, title=title, head=still(head, names), sections=shown)


@cache
def _templates() -> Environment:
    return environment(PackageLoader("inspector.report"))
