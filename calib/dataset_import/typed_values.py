"""Lengths and points as a user types them, in a command's option or on the page."""

from __future__ import annotations

import math
import re


def typed_length_mm(text: str) -> float:
    """Standard deviation above 0, mm, of a text such as "0.05" or "0,05 mm". Raises ValueError with what is needed."""
    return typed_size(text, "standard deviation; a number of mm above 0, such as 0.05")


def typed_size(text: str, needed: str = "length or mass; a number of mm or kg above 0, such as 90") -> float:
    """Number above 0 of a text such as "90", "0,5" or "90 mm". Raises ValueError with what is needed."""
    values = _numbers(text.strip().removesuffix("kg").replace(",", "."))
    if len(values) != 1 or values[0] <= 0.0:
        raise ValueError(f"{text[:40]!r} is no {needed}")
    return values[0]


def typed_point_mm(text: str) -> tuple[float, float, float]:
    """Point, mm, of a text such as "0, 0, 88.5". Raises ValueError with what is needed."""
    values = _numbers(text)
    if len(values) != 3:
        raise ValueError(f"{text[:40]!r} is no point; X, Y, Z in mm, such as 0, 0, 88.5")
    x, y, z = values
    return x, y, z


def _numbers(text: str) -> tuple[float, ...]:
    """Finite numbers between commas, semicolons or spaces; () where anything else is among them."""
    words = [word for word in re.split(r"[,;\s]+", text.strip().removesuffix("mm").strip()) if word]
    try:
        values = tuple(map(float, words))
    except ValueError:
        return ()
    return values if all(map(math.isfinite, values)) and "_" not in text else ()
