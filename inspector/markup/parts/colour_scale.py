"""Colours for numbers: perceptually uniform maps, legible for colour-blind readers, and their scale bars.

`ERROR` goes from blue, which is none, over purple and pink to orange, all about equally light, so that every error
stands out from a light page and from a dark one; `SIGNED` goes from blue over grey, which is zero, to orange.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.html_text import escape
from inspector.markup.parts.palette import UNKNOWN, rgb

ERROR = ("#2C7FD6", "#7878C8", "#A66FA8", "#C6677C", "#D56A3C", "#D07C00")
SIGNED = ("#2166AC", "#67A9CF", "#B9BDC4", "#E8A04C", "#B35806")


def coloured(values: ArrayLike, low: float, high: float, colours: tuple[str, ...]) -> NDArray[np.uint8]:
    """Colours (N, 3), 0-255, of values (N,) on a map from `low` to `high`; values outside get the end's colour."""
    values = np.asarray(values, dtype=float)
    known = np.isfinite(values)
    place = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-12), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(colours))
    anchors = np.array([rgb(c) for c in colours], dtype=float)
    out = np.stack([np.interp(place, stops, anchors[:, k]) for k in range(3)], axis=-1)
    out[~known] = rgb(UNKNOWN)
    return np.round(out).astype(np.uint8)


def round_limit(value: float) -> float:
    """Least 1, 2, 3 or 5 times a power of ten that is not below `value`, as the end of a scale."""
    if not np.isfinite(value) or value <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(m * power for m in (1, 2, 3, 5, 10) if m * power >= value * (1 - 1e-9)))


def bar(title: str, low: float, high: float, colours: tuple[str, ...], *, mark: tuple[float, str] | None = None) -> str:
    """HTML scale bar of a colour map: ends and middle in mm, and a mark at a value of interest."""
    gradient = ",".join(colours)
    sides = zip(("left", "center", "right"), (low, (low + high) / 2, high), strict=True)
    ends = "".join(
        f'<span style="flex:1;text-align:{side}">{_signed(value, low < 0)} mm</span>' for side, value in sides
    )
    needle = below = ""
    if mark is not None and low <= mark[0] <= high:
        share = 100.0 * (mark[0] - low) / (high - low)
        needle = (
            f'<div style="position:absolute;left:calc({share:.2f}% - 1px);top:-3px;bottom:-3px;width:2px;'
            'background:currentColor"></div>'
        )
        below = f'<div style="opacity:0.78">line: {escape(mark[1])}</div>'
    return (
        f'<div style="margin:4px 16px 8px 16px;font-size:12px;line-height:1.5"><div>{escape(title)}</div>'
        f'<div style="position:relative;height:12px;border-radius:2px;margin:3px 0;'
        f'background:linear-gradient(90deg,{gradient})">{needle}</div>'
        f'<div style="display:flex;font-variant-numeric:tabular-nums">{ends}</div>{below}</div>'
    )


def _signed(value: float, sign: bool) -> str:
    return f"{value:+g}" if sign and value > 0 else f"{value:g}"
