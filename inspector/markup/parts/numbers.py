"""Numbers and states in words, with units."""

from __future__ import annotations

import math

from calib.html_text import escape
from inspector.markup.parts.palette import ROLE_WORDS

_GREEK = {"alpha": "α", "beta": "β", "theta": "θ"}


def length(mm: float) -> str:
    """ "0.0123 mm" is "12.3 µm" below a tenth of a millimetre."""
    if not math.isfinite(mm):
        return "–"
    if abs(mm) < 0.1:
        return f"{mm * 1000:#.3g}".rstrip(".") + " µm" if mm else "0 µm"
    return f"{mm:.3f} mm"


def millimetres(mm: float) -> str:
    """Three significant figures, in mm without the unit; powers of ten where it is next to nothing."""
    if not math.isfinite(mm):
        return "–"
    return f"{mm:.1e}" if 0 < abs(mm) < 1e-4 else f"{mm:.4f}" if abs(mm) < 10 else f"{mm:.3f}"


def reduction(before: float, after: float) -> str:
    """By how much an error fell, in percent."""
    if not (math.isfinite(before) and math.isfinite(after)) or before <= 0:
        return "–"
    return f"{100 * (1 - after / before):.2f} %"


def exponent(value: float) -> int:
    """The power of ten of the first digit: -2 of 0.034; 0 of 0."""
    return math.floor(math.log10(abs(value))) if value else 0


def typeset(words: str) -> str:
    """A sentence of the terminal as a page has it: ±, µm, °, and a minus sign."""
    return words.replace("+-", "±").replace(" um", " µm").replace(" -", " −").replace(" deg", "°")


def role(name: str) -> str:
    """The role of a pose as one says it."""
    return ROLE_WORDS.get(name, name)


def count(number: int, one: str) -> str:
    """ "1 scan", "2 scans"."""
    return f"{number:,} {one if number == 1 else one + 's'}"


def listing(names: tuple[str, ...] | list[str], last: str = "and") -> str:
    """ "a, b and c"."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def parameter_label(name: str) -> str:
    """ "alpha3" -> "α3", "aTCP" -> "aTCP": short enough for an axis."""
    for word, letter in _GREEK.items():
        if name.startswith(word):
            return letter + escape(name[len(word) :])
    return escape(name)


def relative_change(before: float, after: float) -> str:
    """ "−63 %": how an error changes."""
    if not (before > 0 and math.isfinite(after)):
        return "–"
    percent = round(100 * (after / before - 1))
    return ("0 %" if percent == 0 else f"{percent:+d} %").replace("-", "−").replace(" ", "\N{NO-BREAK SPACE}")


def probability(p: float) -> str:
    """ "0.012"; powers of ten below 0.001: "5e-31"."""
    return f"{p:.0e}" if p < 0.001 else f"{p:.2g}"
