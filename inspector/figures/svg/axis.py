"""Axis of an SVG figure: its range, its ticks, and the position of a value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inspector.figures.svg.text import plain

_PADDING = 0.05  # of the range, beyond the outermost values
_SMALLEST = 1e-290  # beyond which no tick can be told from the next


@dataclass(frozen=True)
class Axis:
    """Axis between two positions in the picture, px; values of a category axis are its names."""

    title: str
    kind: str  # "linear", "log" or "category"
    low: float  # log10 of the value where `kind` is "log"
    high: float
    categories: tuple[str, ...]
    ticks: tuple[tuple[float, str], ...]  # value as `scaled` gives it, label
    tick_angle_deg: float
    domain: tuple[float, float]
    shows_zero: bool

    def scaled(self, value: object) -> float:
        """Value on the axis' scale; NaN where the scale has no position for it."""
        if self.kind == "category":
            return float(self.categories.index(str(value))) if str(value) in self.categories else math.nan
        if not isinstance(value, int | float):
            return math.nan
        return (
            math.log10(value) if self.kind == "log" and value > 0 else math.nan if self.kind == "log" else float(value)
        )

    def share(self, value: object) -> float:
        """Relative position of a value along the axis, 0 at its start and 1 at its end."""
        return self.share_of_scaled(self.scaled(value))

    def share_of_scaled(self, scaled: float) -> float:
        return (scaled - self.low) / (self.high - self.low)


def axis_of(given: Mapping[str, Any], values: Sequence[object], length_px: float, *, marks: bool) -> Axis:
    """Axis of a layout for these values; `marks`: whether points, which need a margin, lie on it."""
    categories = tuple(dict.fromkeys(str(v) for v in given.get("categoryarray", ()) or values if isinstance(v, str)))
    kind = "category" if categories else str(given.get("type", "linear"))
    numbers = [float(v) for v in values if isinstance(v, int | float) and math.isfinite(v)]
    low, high = _range(given, kind, numbers, len(categories), marks)
    if given.get("autorange") == "reversed":
        low, high = high, low
    found = Axis(
        plain((given.get("title") or {}).get("text", "")),
        kind, low, high, categories, (), float(given.get("tickangle", 0.0) or 0.0),
        (float((given.get("domain") or (0, 1))[0]), float((given.get("domain") or (0, 1))[1])),
        bool(given.get("zeroline", True)) and kind == "linear" and min(low, high) < 0.0 < max(low, high),
    )  # fmt: skip
    return replace(found, ticks=_ticks(found, given, length_px))


def _range(
    given: Mapping[str, Any], kind: str, numbers: Sequence[float], categories: int, marks: bool
) -> tuple[float, float]:
    if given.get("range"):
        return float(given["range"][0]), float(given["range"][1])
    if kind == "category":
        return -0.5, categories - 0.5
    known = np.log10([v for v in numbers if v > 0]) if kind == "log" else np.array(numbers)
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    if given.get("rangemode") == "tozero" and kind == "linear":
        low, high = min(low, 0.0), max(high, 0.0)
    size = (high - low) or abs(high)
    room = _PADDING * (size if size > _SMALLEST else 1.0)
    at_zero = given.get("rangemode") == "tozero" and low == 0.0
    return (low if at_zero else low - (room if marks or high == low else 0.0)), high + room


def _ticks(axis: Axis, given: Mapping[str, Any], length_px: float) -> tuple[tuple[float, str], ...]:
    if given.get("tickvals") is not None:
        texts = given.get("ticktext") or [f"{v:g}" for v in given["tickvals"]]
        named = ((axis.scaled(v), plain(text)) for v, text in zip(given["tickvals"], texts, strict=True))
        low, high = sorted((axis.low, axis.high))
        return tuple((at, text) for at, text in named if low - 1e-9 <= at <= high + 1e-9)
    if axis.kind == "category":
        return tuple((float(k), name) for k, name in enumerate(axis.categories))
    most = min(int(given.get("nticks") or 99), max(3, int(length_px / 55)))
    low, high = sorted((axis.low, axis.high))  # an axis that runs down, as an image's rows do
    step = _nice((high - low) / most)
    first = math.ceil(low / step - 1e-9)
    count = math.floor(high / step + 1e-9) - first + 1
    return tuple(((first + k) * step, f"{(first + k) * step:.6g}") for k in range(count))


def _nice(step: float) -> float:
    """1, 2 or 5 times a power of ten, at least as large as a step."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(s * power for s in (1.0, 2.0, 5.0, 10.0) if s * power >= step * (1.0 - 1e-9))
