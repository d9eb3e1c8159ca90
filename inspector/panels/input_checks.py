"""Checks of values sent by a page, which limit them to what the page's widgets offer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def one_of(value: object, options: Sequence[T], default: T) -> T:
    """`value` if it is one of the options, otherwise `default`."""
    for option in options:
        if type(value) is type(option) and value == option:
            return option
    return default


def clamped(value: object, low: float, high: float, default: float) -> float:
    """`value` within [low, high]; `default` if it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return default
    return min(max(float(value), low), high)


def whole_number(text: str) -> int | None:
    """Number of a text that is a whole number from 0 on with a few digits; else None."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 5 else None
