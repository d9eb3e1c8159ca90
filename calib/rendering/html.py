"""Blocks rendered as HTML: a view in a notebook's cell, part of a page, part of a panel.

Every value is escaped by jinja2. A view takes the colours of text and background from where it stands, so that it is
light where that is light and dark where that is dark; it holds no script and asks no network, and its rules of style
count below `.calib-view` only. In a panel a reference is a link that selects what it names: an element with `data-ask`
and `data-value`, which the page's own script sends to the server.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import count

from jinja2 import BaseLoader, ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from calib.html_text import escape, visible_value
from calib.rendering.blocks import (
    Bar,
    Block,
    Coloured,
    Drawing,
    FigurePlace,
    Link,
    Paragraph,
    Presentation,
    Reference,
    Section,
    Small,
    shown,
)

Draw = Callable[[FigurePlace, str], str]  # a place and the name that begins its ids -> SVG

IDS = "figures-of-this-view"  # begins the ids of drawings; each view has its own in its stead


def view(told: Presentation, draw: Draw | None = None) -> str:
    """Presentation of a result as HTML for a notebook: a `<div>` that fits into any page.

    draw: what draws its figures; without it they are left out.
    """
    names = (f"{IDS}-{number}" for number in count(1))
    html = _templates(links=False).get_template("view.html").render(title=told.title, **drawn(told, draw, names))
    return html.replace(IDS, f"view{zlib.crc32(html.encode()):08x}")


def panel(told: Sequence[Block | Section]) -> str:
    """HTML of blocks and sections for a panel of the page, without figures, which are widgets of the panel.

    "" where they have nothing to show.
    """
    blocks: list[Block] = []
    for part in told:
        if isinstance(part, Section):
            blocks += [Paragraph(part.heading, heading=True), *part.blocks] if shown(part.blocks) else []
        else:
            blocks.append(part)
    without_figures = with_figures(blocks, None, iter(()))
    return (
        _templates(links=True).get_template("panel.html").render(blocks_shown=without_figures)
        if without_figures
        else ""
    )


def drawn(told: Presentation, draw: Draw | None, names: Iterator[str]) -> dict[str, object]:
    """Template variables with the head and sections of a presentation, every figure drawn.

    names: a name a figure, which its ids begin with.
    """
    sections = [Section(s.heading, with_figures(s.blocks, draw, names)) for s in told.sections if shown(s.blocks)]
    return {"head": with_figures(told.head, draw, names), "sections": sections}


def with_figures(blocks: Sequence[Block], draw: Draw | None, names: Iterator[str]) -> list[Block]:
    """Blocks with each figure's placeholder replaced by its drawing, or dropped where none can be made."""
    return [
        Drawing(draw(block, next(names)), block.caption) if draw and isinstance(block, FigurePlace) else block
        for block in shown(blocks)
        if draw or not isinstance(block, FigurePlace)
    ]


def environment(*loaders: BaseLoader, links: bool = False) -> Environment:
    """Jinja environment of templates that use the blocks' macros (`blocks.html`), from these loaders and this package.

    links: whether references are links that select what they name.
    """
    made = Environment(
        loader=ChoiceLoader([*loaders, PackageLoader("calib.rendering")]),
        autoescape=True,
        finalize=visible_value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=bool(loaders),
    )
    made.filters["words"] = lambda words: Markup(words_html(words, links))
    made.filters["selecting"] = lambda reference: Markup(_asks(reference) if links and reference else "")
    return made


@cache
def _templates(links: bool) -> Environment:
    return environment(links=links)


def words_html(words: object, links: bool) -> str:
    """HTML of a sentence or a cell, escaped; with `links` its references become links that select their objects."""
    match words:
        case Reference():
            return f'<a class="asks"{_asks(words)}>{escape(words.words)}</a>' if links else escape(words.words)
        case Link():
            return f'<a href="{escape(words.address)}">{escape(words.words)}</a>'
        case Coloured():
            return f'<i class="swatch" style="background:{escape(words.colour)}"></i>&nbsp;{escape(words.words)}'
        case Bar():
            return f'<span class="bar" style="--share:{100 * words.share:.0f}%">{escape(words.words)}</span>'
        case Small():
            return f'<small class="key-of">{escape(words.words)}</small>'
        case list() | tuple():
            return "".join(words_html(span, links) for span in words)
        case _ if hasattr(words, "__html__"):
            return str(words)
        case _:
            return escape(words)


def _asks(reference: Reference) -> str:
    """HTML attributes that make an element, when clicked, select the object of a reference."""
    asked = f'data-ask="{reference.kind}" data-value="{escape(reference.value)}"'
    return f' {asked} role="button" tabindex="0"'
