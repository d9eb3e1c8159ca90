"""One HTML page that stands alone: text, tables, and figures as SVG. It holds no script and asks no network.

It is light or dark as the reader's system is, and prints light, the first page for the customer. What it looks like is
in `templates/`, where jinja2 escapes every value.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import count

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from calib.display.blocks import Block, Section
from calib.display.html_text import visible_value
from inspector.report.figure_block import still

MARK = '<meta name="generator" content="robot-calibration-inspector">'
"""Tells a report from any other file; among the first characters of the page."""


def render_page(title: str, head: Sequence[Block], sections: Sequence[Section]) -> str:
    """The whole page: a head, which is the first page on paper, then the sections."""
    names = (f"figure{number}" for number in count(1))

    shown = [{"heading": section.heading, "blocks": still(section.blocks, names)} for section in sections]
    template = _templates().get_template("page.html")
    return template.render(mark=MARK, title=title, head=still(head, names), sections=shown)


@cache
def _templates() -> Environment:
    return Environment(
        loader=ChoiceLoader([PackageLoader("inspector.report"), PackageLoader("calib.display")]),
        autoescape=True,
        finalize=visible_value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
