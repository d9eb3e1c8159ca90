"""Whether two results say the same: numbers to a tolerance, words to the letter."""

from __future__ import annotations

import json
import math
from typing import Any

SKIPPED = {"iterations", "seconds", "files", "warnings", "explanation", "notes"}
RELATIVE, OF_A_SIGMA = 1e-5, 1e-3


def difference(a: Any, b: Any, place: str = "") -> str:
    """The first place where two JSON documents differ; "" where they say the same.

    A number beside a `sigma` may differ by a thousandth of it, another by 1e-5 of itself, which is what the order of
    sums and the end of an iteration leave.
    """
    if isinstance(a, dict) and isinstance(b, dict):
        if set(a) != set(b):
            return f"{place}: keys {sorted(set(a) ^ set(b))}"
        for key in a:
            if key in SKIPPED:
                continue
            sigma = a.get("sigma") if key == "value" else None
            found = difference_by(a[key], b[key], f"{place}.{key}", sigma)
            if found:
                return found
        return ""
    if isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            return f"{place}: {len(a)} and {len(b)} entries"
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            name = x.get("name", k) if isinstance(x, dict) else k
            found = difference(x, y, f"{place}[{name}]")
            if found:
                return found
        return ""
    return difference_by(a, b, place, None)


def difference_by(a: Any, b: Any, place: str, sigma: float | None) -> str:
    """Difference of one value with its sigma, "" where there is none beyond the tolerance."""
    if isinstance(a, dict | list):
        return difference(a, b, place)
    if isinstance(a, float) and isinstance(b, float | int):
        absolute = OF_A_SIGMA * sigma if sigma else 1e-9
        same = math.isclose(a, b, rel_tol=RELATIVE, abs_tol=absolute) or (math.isnan(a) and math.isnan(b))
        return "" if same else f"{place}: {a:.9g} and {b:.9g}"
    return "" if a == b else f"{place}: {str(a)[:80]!r} and {str(b)[:80]!r}"


def difference_of_texts(a: str, b: str, keys: tuple[str, ...] = ()) -> str:
    """First difference of two JSON texts, or of some of their keys; "" where they say the same."""
    first, second = json.loads(a), json.loads(b)
    if keys:
        first, second = ({key: tree[key] for key in keys} for tree in (first, second))
    return difference(first, second)
