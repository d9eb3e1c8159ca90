"""Number formats, the same on terminal, page, report and notebook.

In a sentence a length has the digits that a person reads (two significant ones, two decimals above one) and the unit
that fits it; in a column, whose unit is in its heading, it has four decimals. A size with its sigma has the digits that
the sigma leaves. Angles are in degrees. U+2212 is the minus sign.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TypeVar

from calib.options import GREEK_LETTERS

_T = TypeVar("_T")

MISSING = "–"
MINUS = "\N{MINUS SIGN}"
_MICRO_BELOW_MM = 0.0995  # what is nearer to a tenth of a millimetre is written as that
_NOTHING_MM = 1e-6  # a nanometre: less is rounding
_SMALLEST_SHARE = 0.005  # that rounds to 1 %
_UNSEEN = 1e6  # a sigma from which a size says nothing, in its unit


def length(mm: float) -> str:
    """Text of a length in a sentence: "0.68 mm"; "12 µm" below a tenth of a millimetre."""
    if not math.isfinite(mm):
        return MISSING
    if abs(mm) < _NOTHING_MM:
        return "0 µm"
    if abs(float(f"{mm:.2g}")) < _MICRO_BELOW_MM:
        return f"{float(f'{1e3 * mm:.2g}'):g} µm".replace("-", MINUS)
    return f"{digits(mm)} mm"


def length_change(before_mm: float, after_mm: float) -> str:
    """Text of the change of an error, in one unit: "from 0.68 to 0.041 mm"."""
    if max(abs(before_mm), abs(after_mm)) < _MICRO_BELOW_MM:
        return f"from {length(before_mm).removesuffix(' µm')} to {length(after_mm)}"
    return f"from {digits(before_mm)} to {digits(after_mm)} mm"


def digits(value: float) -> str:
    """Text of a number with readable digits: two significant ones, two decimals above one."""
    if not math.isfinite(value):
        return MISSING
    size = abs(value)
    if size == 0.0 or size >= 99.95:
        written = f"{value:.0f}"
    elif size >= 0.995:
        written = f"{value:.1f}" if size >= 9.995 else f"{value:.2f}"
    else:
        written = f"{value:.{1 - math.floor(math.log10(float(f'{size:.1e}')))}f}"
    return written.replace("-", MINUS)


def column_mm(mm: float | None) -> str:
    """Text of a length in a column of millimetres; a power of ten for very small values."""
    if mm is None or not math.isfinite(mm):
        return MISSING
    written = f"{mm:.1e}" if 0 < abs(mm) < 1e-4 else f"{mm:.4f}" if abs(mm) < 10 else f"{mm:.3f}"
    return written.replace("-", MINUS) if mm < 0 else written


def signed(value: float, spec: str) -> str:
    """Text of a number by a format specification, with a typographic minus sign."""
    written = f"{value:{spec}}"
    return MINUS + written[1:] if written.startswith("-") else written


def coordinate(mm: float) -> str:
    """Text of a coordinate in millimetres with three decimals."""
    return signed(mm, "z.3f")


def readable(value: float, unit: str) -> tuple[float, str]:
    """A value and its unit converted for readers: angles in degrees."""
    return (math.degrees(value), "°") if unit == "rad" else (value, unit)


def size(value: float, unit: str) -> str:
    """Text of a size with its unit: "0.12°", "0.5 mm", "3e-05 rad/Nm"."""
    shown, unit = readable(value, unit)
    return f"{shown:.3g}{_unit(unit)}".replace("-", MINUS, 1 if shown < 0 else 0)


def with_sigma(value: float, sigma: float, unit: str = "", *, sign: bool = False) -> str:
    """Text of a value and its sigma to two digits of the sigma: "0.120 ± 0.011°"; "not seen" for an unbounded sigma."""
    shown, read_unit = readable(value, unit)
    spread, _ = readable(sigma, unit)
    if not math.isfinite(spread) or spread >= _UNSEEN:
        return "not seen"
    plus = "+" if sign else ""
    if spread <= 0.0:
        return f"{shown:{plus}.4g} ± 0{_unit(read_unit)}".replace("-", MINUS)
    decimals = 1 - math.floor(math.log10(float(f"{spread:.1e}")))
    if decimals > 6:
        exponent = math.floor(math.log10(max(abs(shown), spread)))
        scaled = max(0, decimals + exponent)
        written = f"({shown / 10**exponent:{plus}.{scaled}f} ± {spread / 10**exponent:.{scaled}f})e{exponent}"
        return f"{written}{_unit(read_unit)}".replace("-", MINUS)
    decimals = max(0, decimals)
    return f"{shown:{plus}z.{decimals}f} ± {spread:.{decimals}f}{_unit(read_unit)}".replace("-", MINUS)


def _unit(unit: str) -> str:
    return unit if unit in ("", "°") else "" if unit == "1" else f" {unit}"


def share(fraction: float) -> str:
    """Text of a share in percent: "12 %"."""
    return f"{100 * fraction:.0f} %"


def bounded_share(fraction: float) -> str:
    """A share in percent that is 0 % or 100 % only where it is exactly so: "<1 %", "42 %", ">99 %"."""
    if 0.0 < fraction < _SMALLEST_SHARE:
        return "<1 %"
    return ">99 %" if 1.0 - _SMALLEST_SHARE <= fraction < 1.0 - 1e-9 else share(fraction)


def reduction(before: float, after: float) -> str:
    """Text of the decrease of an error, in percent of its earlier value."""
    if not (math.isfinite(before) and math.isfinite(after)) or before <= 0:
        return MISSING
    return f"{100 * (1 - after / before):.2f} %".replace("-", MINUS)


def relative_change(before: float, after: float) -> str:
    """Text of the change of an error, in percent of its earlier value: "−63 %"."""
    if not (before > 0 and math.isfinite(after)):
        return MISSING
    percent = round(100 * (after / before - 1))
    return ("0 %" if percent == 0 else f"{percent:+d} %").replace("-", MINUS).replace(" ", "\N{NO-BREAK SPACE}")


def probability(p: float) -> str:
    """Text of a probability or a p-value: "0.012"; a power of ten below 0.001: "5e-31"."""
    return f"{p:.0e}" if p < 0.001 else f"{p:.2g}"


def times(ratio: float) -> str:
    """Text of a ratio in a sentence: "6.4 times", "120 times"."""
    written = f"{float(f'{ratio:.2g}'):.7g}"
    return f"{'1.0' if written == '1' else written} times"


def count(number: int, one: str, several: str = "") -> str:
    """Text of a number with its noun: "1 scan", "2 scans"; `several` is an irregular plural of the noun."""
    return f"{number:,} {one if number == 1 else several or one + 's'}"


def listing(names: Sequence[object], last: str = "and") -> str:
    """Names joined for a sentence: "a, b and c"."""
    said = [str(name) for name in names]
    return f"{', '.join(said[:-1])} {last} {said[-1]}" if len(said) > 1 else "".join(said)


def first_of(names: Sequence[_T], most: int) -> list[_T | str]:
    """The first names of many, then how many more there are."""
    more = len(names) - most
    return [*names[:most], *([f"{more} more"] if more > 0 else [])]


def in_short(names: Sequence[object], most: int) -> str:
    """The first names of many for a message: "a, b and 7 more"; separated by commas where all are told."""
    return listing(first_of(names, most)) if len(names) > most else ", ".join(map(str, names))


def natural_order(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key of names that takes the numbers in them by value, so that "A-9" comes before "A-10"."""
    parts = re.split(r"([0-9]+)", name)
    return tuple((0, int(part), "") if k % 2 else (1, 0, part) for k, part in enumerate(parts) if part)


def capitalised(words: str) -> str:
    """A sentence with a capital letter first."""
    return words[:1].upper() + words[1:]


def parameter_label(name: str) -> str:
    """Parameter's short name as in tables and on axes: "α3" for "alpha3"."""
    for word, letter in GREEK_LETTERS.items():
        if name.startswith(word):
            return letter + name[len(word) :]
    return name
