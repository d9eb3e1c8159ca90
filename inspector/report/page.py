"""Self-contained HTML page: text, tables, and figures as SVG, without scripts or network access.

It is light or dark as the reader's system is, and prints light, the first page for the customer. What it looks like is
in `templates/`, where jinja2 escapes every value.
"""

from __future__ import annotations

from functools import cache
from itertools import count

from jinja2 import Environment, PackageLoader

from calib.rendering.blocks import Presentation
from calib.rendering.html import drawn, environment
from inspector.figures.results.places import draw

MARK = '<meta name="generator" content="robot-calibration-inspector">'
"""Tells a report from any other file; among the first characters of the page."""


def render(told: Presentation) -> str:
    """HTML page of a presentation with its figures: the head (the first page when printed), then the sections."""
    names = (f"figure{number}" for number in count(1))
    shown = drawn(told, draw, names)
    return _templates().get_template("page.html").render(mark=MARK, title=told.title, **shown)


@cache
def _templates() -> Environment:
    return environment(PackageLoader("inspector.report"))
