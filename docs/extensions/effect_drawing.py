"""What the pictures of effects share: SVG that stands in a page, whose ink and lines have the page's colour."""

from __future__ import annotations

from html import escape

import numpy as np

from calib.array_types import Array

BEFORE, AFTER = (
    "#C66A00",
    "#0F8AC4",
)  # the effect alone; what geometry leaves of it; seen on light and on dark pages
WIDTH, PANEL = 720.0, 352.0


def number(value: float) -> str:
    """A coordinate, a tenth of a pixel fine."""
    return f"{value:.1f}".removesuffix(".0")


def svg(body: str, width: float, height: float, words: str) -> str:
    """A picture of this size at the most; `words` are read aloud."""
    said = escape(words, quote=True)
    least = 540.0 if width > 540.0 else 0.0  # of a wide one on a phone, which then moves it sideways
    size = f"width:100%;min-width:{number(least)}px;max-width:{number(width)}px;height:auto"
    return (
        f'<svg viewBox="0 0 {number(width)} {number(height)}" role="img" aria-label="{said}" style="{size}" '
        f'font-size="12" fill="currentColor">{body}</svg>'
    )


def text(words: str, x: float, y: float, *, anchor: str = "start", extra: str = "") -> str:
    """A line of words."""
    return f'<text x="{number(x)}" y="{number(y)}" text-anchor="{anchor}"{extra}>{escape(words)}</text>'


def dots(x: Array, y: Array, radius: float) -> str:
    """The path of points (N,), (N,)."""
    r, d = number(radius), number(2.0 * radius)
    return "".join(
        f"M{number(a - radius)} {number(b)}a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0 -{d} 0"
        for a, b in zip(x.tolist(), y.tolist(), strict=True)
    )


def arrow(start: Array, end: Array, colour: str, width: float) -> str:
    """An arrow between two places (2,); none where they are nearly the same."""
    (x0, y0), (x1, y1) = start, end
    length = float(np.hypot(x1 - x0, y1 - y0))
    if length < 1.5:
        return ""
    head = min(3.2 * width + 1.5, 0.6 * length)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    bx, by = x1 - head * ux, y1 - head * uy
    half = 0.45 * head
    tip = f"M{number(x1)} {number(y1)}"
    sides = f"L{number(bx - half * uy)} {number(by + half * ux)}L{number(bx + half * uy)} {number(by - half * ux)}z"
    line = f"M{number(x0)} {number(y0)}L{number(bx)} {number(by)}"
    return f'<path d="{line}" stroke="{colour}" stroke-width="{width:g}"/><path d="{tip}{sides}" fill="{colour}"/>'
