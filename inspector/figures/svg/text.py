"""Text and numbers in SVG."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping

from calib.html_text import escape

SMALL_PX, USUAL_PX = 10.5, 11.5
_WIDTH = 0.56  # of a character, over the size of the font

_TAG = re.compile(r"<[^>]*>")
_PLACE = re.compile(r"%\{(\w+)(?::([^}]*))?\}")


def plain(text: object) -> str:
    """Text of a plotly label without markup and escapes."""
    return html.unescape(_TAG.sub("", str(text)))


def escaped(text: object) -> str:
    """Text escaped so that it cannot become markup."""
    return escape(text)


def width_px(text: str, size_px: float = SMALL_PX) -> float:
    """Estimated width of a line of text, px."""
    return _WIDTH * size_px * len(text)


def number(value: float) -> str:
    """Coordinate as text, to a tenth of a pixel."""
    return f"{value:.1f}".removesuffix(".0")


def label(
    words: str, x: float, y: float, *, size_px: float = SMALL_PX, anchor: str = "middle", turn_deg: float = 0.0,
    css: str = "",
) -> str:  # fmt: skip
    """SVG of a line of text whose middle (or start, or end) is at a position, centred vertically."""
    turned = f' transform="rotate({number(turn_deg)} {number(x)} {number(y)})"' if turn_deg else ""
    style = f' class="{css}"' if css else ""
    return (
        f'<text x="{number(x)}" y="{number(y)}" font-size="{number(size_px)}" text-anchor="{anchor}" '
        f'dominant-baseline="central"{style}{turned}>{escaped(words)}</text>'
    )


def hover(template: str | None, values: Mapping[str, object]) -> str:
    """Hover text of a mark, from plotly's hovertemplate; "" where the trace has none."""
    if not template:
        return ""

    def shown(place: re.Match[str]) -> str:
        value, form = values.get(place[1], ""), place[2]
        return format(value, form) if form and isinstance(value, int | float) else str(value)

    told = _PLACE.sub(shown, re.sub(r"<extra>.*</extra>", "", template))
    words = plain(told.replace("<br>", "\n"))
    return f"<title>{escaped(words)}</title>"
