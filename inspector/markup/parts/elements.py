"""HTML elements for the panels: tables, facts, notes. All external text is escaped in this module.

Colours are left to the page (which is light or dark); the tables only use its own text colour, thinned.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from calib.html_text import escape
from calib.rendering.blocks import LONG_NAME as LONG_NAME

_CELL = "padding:2px 6px;white-space:nowrap;"
_BREAK = "overflow-wrap:anywhere;"  # names from outside may be one long word
MARK = "rgba(86,180,233,0.22)"  # behind a row that is selected
_LINE = "border-bottom:1px solid rgba(128,128,128,0.28);"


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
    return f"<style>tr{mine}{{background:{MARK}}}a{mine}{{font-weight:600}}</style>"


class Html(str):
    """Text that is HTML markup with its parts escaped already."""


def _markup(value: object) -> str:
    return value if isinstance(value, Html) else text(value)


def text(value: object) -> str:
    """Text of `value`, escaped so that it cannot become markup."""
    return escape(str(value), quote=True)


def table(
    headers: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    left: int = 1,
    mark: int | None = None,
    height: str = "",
    asks: Sequence[Html] | None = None,
) -> str:
    """HTML of a compact table: the first `left` columns aligned left, numbers right; row `mark` is emphasised.

    asks: what a click on each row asks for (`asking`), "" where nothing.

    Cells are escaped unless they are `Html`. `height` (CSS) makes a longer table scroll by itself.
    """

    def cell(tag: str, column: int, value: object, extra: str = "") -> str:
        align = "left" if column < left else "right"
        shown = _markup(value) if column >= left or isinstance(value, Html) else _name(value)
        return f'<{tag} style="{_CELL}{_LINE}text-align:{align};{extra}">{shown}</{tag}>'

    # The heading stays while the table scrolls, on the page's own colour.
    stay = "position:sticky;top:0;background:var(--mantine-color-body);" if height else ""
    head = "".join(cell("th", i, h, f"font-weight:600;{stay}") for i, h in enumerate(headers))
    body = []
    for number, row in enumerate(rows):
        style = f' style="background:{MARK}"' if number == mark else ""
        ask = asks[number] if asks is not None else ""
        body.append(f"<tr{style}{ask}>" + "".join(cell("td", i, v) for i, v in enumerate(row)) + "</tr>")
    scroll = f"max-height:{height};overflow-y:auto;" if height else ""
    return (
        f'<div style="overflow-x:auto;{scroll}margin:2px 10px 6px 10px">'
        '<table class="compact" style="border-collapse:collapse;width:100%;font-size:12px;line-height:1.35;'
        f'font-variant-numeric:tabular-nums"><thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
    )


def asking(name: str, value: object, *, tab: str = "") -> Html:
    """HTML attributes of an element that sends a request when clicked, or chosen by key.

    `name` is one of the requests that the app answers (`server/page_requests.py`); `tab` ("Learn/Where it fails") is
    opened, too.
    """
    opens = f' data-tab="{text(tab)}"' if tab else ""
    return Html(f' data-ask="{text(name)}" data-value="{text(value)}"{opens} role="button" tabindex="0"')


def opening(tab: str) -> Html:
    """HTML attributes of an element that opens a tab ("Learn/Where it fails") when clicked, or chosen by key."""
    return Html(f' data-tab="{text(tab)}" role="button" tabindex="0"')


def pose_link(pose_id: object, words: object = "") -> Html:
    """HTML of a pose's name (or of `words`) within a sentence or a cell; a click selects the pose."""
    return Html(f'<a class="asks"{asking("pose", pose_id)}>{text(words or pose_id)}</a>')


def tab_link(tab: str, words: object, *, ask: str = "") -> Html:
    """HTML of words in a sentence that open a tab ("Learn/Plan") when clicked, and send the request `ask`, if any."""
    return Html(f'<a class="asks"{asking(ask, "", tab=tab) if ask else opening(tab)}>{text(words)}</a>')


def joint_link(number: int, words: object = "") -> Html:
    """HTML of a joint's name (or of `words`), counted from 1, in a sentence or a cell; a click selects the joint."""
    return Html(f'<a class="asks"{asking("joint", number)}>{text(words or number)}</a>')


def wrapping(value: object) -> Html:
    """HTML of a table cell that may take several lines."""
    return Html(f'<span style="white-space:normal">{_markup(value)}</span>')


def _name(value: object) -> str:
    """HTML of a name; one with a long word may take several lines, so that the other columns keep their width."""
    if max(map(len, str(value).split()), default=0) <= LONG_NAME:
        return text(value)
    # At least 7.5em wide, more where the other columns leave it.
    wide = "display:inline-block;min-width:7.5em;white-space:normal;vertical-align:top;"
    return f'<span style="{wide}{_BREAK}">{text(value)}</span>'


def swatch(colour: str) -> Html:
    """HTML of a small square in a colour of the palette (never one from outside)."""
    return Html(
        f'<span style="display:inline-block;width:10px;height:10px;border-radius:2px;background:{colour};'
        'vertical-align:baseline"></span>'
    )


def named_swatch(colour: str, name: object) -> Html:
    """HTML of a coloured square followed by its meaning."""
    return Html(f"{swatch(colour)}&nbsp;{_name(name)}")


def legend(entries: Iterable[tuple[str, object]], *, before: str = "") -> str:
    """HTML legend of colours and meanings, in one line; `before` is a common prefix."""
    items = "".join(
        f'<span style="margin-right:12px;white-space:nowrap">{named_swatch(colour, name)}</span>'
        for colour, name in entries
    )
    shared = f'<span style="margin-right:8px">{text(before)}</span>' if before else ""
    return f'<div style="margin:2px 16px 6px 16px;font-size:12px;line-height:1.6">{shared}{items}</div>'


def note(sentence: object) -> str:
    """HTML of a tab's explanatory line: what it shows and what to look for."""
    style = f"margin:4px 16px 8px 16px;font-size:12px;line-height:1.4;opacity:0.78;{_BREAK}"
    return f'<div style="{style}">{_markup(sentence)}</div>'


def code(lines: object) -> str:
    """HTML of lines to be typed literally."""
    style = "margin:4px 16px 8px 16px;padding:6px 10px;font-size:12px;white-space:pre-wrap;"
    style += "background:rgba(128,128,128,0.14);"
    return f'<pre style="{style}{_BREAK}">{text(lines)}</pre>'


def heading(title: object) -> str:
    """HTML of a small heading inside a tab."""
    return f'<div style="margin:10px 16px 2px 16px;font-size:13px;font-weight:600;{_BREAK}">{text(title)}</div>'


def alert(sentence: object, *, colour: str = "#B3261E") -> str:
    """HTML of an emphasised line: a failure with its reason."""
    return (
        f'<div style="margin:4px 14px 8px 14px;padding:6px 10px;border-left:4px solid {colour};font-size:12px;'
        f'line-height:1.4;background:rgba(128,128,128,0.14);{_BREAK}">{_markup(sentence)}</div>'
    )


def facts(pairs: Iterable[tuple[str, object]]) -> str:
    """HTML table of names and values, one row each."""
    rows = "".join(
        f'<tr><td style="{_CELL}opacity:0.75">{text(name)}</td>'
        f'<td style="{_CELL}white-space:normal;text-align:right;{_BREAK}">{_markup(value)}</td></tr>'
        for name, value in pairs
    )
    return (
        '<div style="margin:2px 10px 6px 10px"><table style="border-collapse:collapse;width:100%;font-size:12px;'
        f'line-height:1.4;font-variant-numeric:tabular-nums">{rows}</table></div>'
    )
