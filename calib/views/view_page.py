"""A view of a result for a notebook's cell: a title, what matters most, and sections that open with a click.

It takes the colours of text and background from where it stands, so that it is light where that is light and dark where
that is dark. It holds no script and asks no network, and its rules of style count below `.calib-view` only. jinja2
escapes every value.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from functools import cache

from jinja2 import Environment

from calib.present.blocks import Block, Section
from calib.present.html import environment

FIGURES = "figures-of-this-view"  # begins the ids of drawings; each view has its own in its stead


def view_html(title: str, head: Sequence[Block], sections: Sequence[Section] = ()) -> str:
    """The view as HTML: a `<div>` that can stand in any page."""
    html = _templates().get_template("view.html").render(title=title, head=head, sections=sections)
    return html.replace(FIGURES, f"view{zlib.crc32(html.encode()):08x}")


@cache
def _templates() -> Environment:
    return environment()
