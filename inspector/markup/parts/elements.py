"""Lines of a panel in one call, links that open tabs, legends; all else in panels is blocks (`calib.rendering`)."""

from __future__ import annotations

from collections.abc import Iterable

from markupsafe import Markup

from calib.html_text import escape
from calib.rendering.blocks import Coloured, Paragraph, Verdict, Words, joined, spans
from calib.rendering.html import panel
from inspector.markup.parts.palette import FAILED

_MARK = "rgba(86,180,233,0.22)"  # behind a row that is selected
_APART = "\N{NO-BREAK SPACE} \N{NO-BREAK SPACE} "  # between the entries of a legend

# Viser writes labels in Mantine's dimmed grey, whose contrast is 3.3 (light) and 4.0 (dark): here it is 6 and more.
STYLE = (
    '<style>:root[data-mantine-color-scheme="light"]{--mantine-color-dimmed:#5C636A}'
    ':root[data-mantine-color-scheme="dark"]{--mantine-color-dimmed:#B4B8BC}'
    ".js-plotly-plot~button{color:#24292F}"  # the sign that enlarges a figure is always on white
    "[data-ask]{cursor:pointer}tr[data-ask]:hover{background:rgba(128,128,128,0.16)}"
    "a.asks{text-decoration:underline dotted;text-underline-offset:2px}a.asks:hover{text-decoration:underline}"
    "[data-ask]:focus-visible{outline:2px solid #56B4E9;outline-offset:-1px}</style>"
)


def joint_style(joint: int | None) -> str:
    """CSS that marks every row and link of the selected joint, counted from 0."""
    if joint is None:
        return ""
    mine = f'[data-ask="joint"][data-value="{joint + 1}"]'
    return f"<style>tr{mine}{{background:{_MARK}}}a{mine}{{font-weight:600}}</style>"


def asking(name: str, value: object, *, tab: str = "") -> Markup:
    """HTML attributes of an element that sends a request when clicked, or chosen by key.

    `name` is one of the requests that the app answers (`server/page_requests.py`); `tab` ("Learn/Where it fails") is
    opened, too.
    """
    opens = f' data-tab="{escape(tab)}"' if tab else ""
    return Markup(f' data-ask="{escape(name)}" data-value="{escape(value)}"{opens} role="button" tabindex="0"')


def opening(tab: str) -> Markup:
    """HTML attributes of an element that opens a tab ("Learn/Where it fails") when clicked, or chosen by key."""
    return Markup(f' data-tab="{escape(tab)}" role="button" tabindex="0"')


def tab_link(tab: str, words: object, *, ask: str = "") -> Markup:
    """HTML of words in a sentence that open a tab ("Learn/Plan") when clicked, and send the request `ask`, if any."""
    return Markup(f'<a class="asks"{asking(ask, "", tab=tab) if ask else opening(tab)}>{escape(words)}</a>')


def note(sentence: Words) -> str:
    """HTML of a tab's explanatory line: what it shows and what to look for."""
    return panel([Paragraph(sentence, soft=True)])


def heading(title: str) -> str:
    """HTML of a small heading inside a tab."""
    return panel([Paragraph(title, heading=True)])


def alert(sentence: Words, *, colour: str = FAILED) -> str:
    """HTML of an emphasised line, a failure with its reason; "" where it says nothing."""
    return panel([Verdict(sentence, colour)])


def legend(entries: Iterable[tuple[str, object]], *, before: str = "") -> str:
    """HTML legend of colours and meanings, in one line; `before` is a common prefix."""
    return panel([Paragraph(spans(before and f"{before} ", joined((Coloured(str(n), c) for c, n in entries), _APART)))])
