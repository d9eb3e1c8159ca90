"""Axis ranges without outlying values, and marks with the number of values beyond the range.

A value is wild where it lies more than `FAR` times as far from the middle as nine in ten of all values do. Where more
than one in twenty (and more than two) would be, they are no exceptions and all is shown. A triangle at the edge stands
where each wild value is, which a click selects as any other point; a line of text counts them. A double-click on the
figure shows all; then the script that is served with the page hides both (server/client/plots.js).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray
from inspector.figures.style import EDGE, SELECTS_POSE, VEIL, Part, scatter

FAR = 4.0
FEWEST = 8  # values of which some can be exceptions
MOST_SHARE, MOST = 0.05, 2
PAD = 0.08  # of the range, on either side


@dataclass(frozen=True)
class RobustRange:
    """Range of an axis from `low` to `high`, which contains all but the outlying values."""

    low: float
    high: float
    wild: BoolArray  # (N,)
    farthest: float  # the wild value that lies farthest out


def robust_range(values: ArrayLike, *, from_zero: bool = False) -> RobustRange | None:
    """Range of values (N,), which may hold NaN, without outlying ones; None where plotly's usual range is good enough.

    from_zero: the axis begins there.
    """
    v = np.asarray(values, dtype=float)
    known = v[np.isfinite(v)]
    if len(known) < FEWEST:
        return None
    middle = 0.0 if from_zero else float(np.median(known))
    usual = float(np.quantile(np.abs(known - middle), 0.9, method="lower"))
    wild = np.isfinite(v) & (np.abs(np.where(np.isfinite(v), v, middle) - middle) > FAR * usual)
    count = int(wild.sum())
    if usual <= 0.0 or count == 0 or count > max(MOST, MOST_SHARE * len(known)):
        return None
    inside = v[np.isfinite(v) & ~wild]
    low, high = (0.0 if from_zero else float(inside.min())), float(inside.max())
    pad = PAD * (high - low)
    far = v[wild]
    farthest = float(far[np.argmax(np.abs(far - middle))])
    return RobustRange(low - (0.0 if from_zero else pad), high + pad, wild, farthest)


def within_range(
    values: Array, x: Sequence[Any], names: Sequence[str], unit: str, *, from_zero: bool
) -> tuple[Part, list[Part], list[Part]]:
    """Keys of a y axis that shows all but outlying values, triangles at its edge for these, and their number as a text.

    x, names: of each value, where it stands on the x axis and its pose, escaped.
    """
    shown = robust_range(values, from_zero=from_zero)
    if shown is None:
        return {"rangemode": "tozero" if from_zero else "normal"}, [], []
    at = [int(i) for i in np.flatnonzero(shown.wild)]
    above = values[at] > shown.high
    inset = 0.02 * (shown.high - shown.low)
    more = {
        "showlegend": False, "cliponaxis": False, "ids": [names[i] for i in at],
        "meta": {**SELECTS_POSE, "beyond": True},
        "text": [f"pose {names[i]}<br>{values[i]:.4g} {unit}, beyond this axis" for i in at],
    }  # fmt: skip
    triangles = {"symbol": np.where(above, "triangle-up", "triangle-down").tolist(), "size": 11, "color": EDGE}
    y = np.where(above, shown.high - inset, shown.low + inset)
    edge = scatter("beyond", [x[i] for i in at], y, marker=triangles, hover="%{text}", more=more)
    side, shift, place = ("top", -14, 1) if above.any() else ("bottom", 14, 0)
    text = {
        "name": "beyond", "text": f"{len(at)} beyond, up to {shown.farthest:.3g} {unit}".strip().replace("-", "−"),
        "xref": "paper", "yref": "y domain", "x": 1, "y": place, "xanchor": "right", "yanchor": side, "yshift": shift,
        "showarrow": False, "font": {"size": 11}, "bgcolor": VEIL,
    }  # fmt: skip
    return {"range": [shown.low, shown.high]}, [edge], [text]
