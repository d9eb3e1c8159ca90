"""Units in the names of columns: q1_deg, "J1 [rad]", "x (mm)"."""

from __future__ import annotations

import re

UNITS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad",
    "mm": "mm", "m": "m", "meter": "m", "metre": "m", "meters": "m", "cm": "cm", "in": "in", "inch": "in", "um": "um",
    "kg": "kg", "s": "s", "sec": "s", "c": "c", "°c": "c", "degc": "c",
}  # fmt: skip
"""Units as they are written, and as they are called here."""
MOST_CHARACTERS = 200  # of a name that tells anything
_UNIT = re.compile(r"^(?P<name>.*?)(?:[\s_]*[\[(]\s*(?P<bracket>[^\])]+?)\s*[\])]|[\s_.]+(?P<end>[^\s_.\d]+))$")


def split_unit(name: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit; "" where it has none that is known."""
    found = _UNIT.match(name.strip()) if len(name) <= MOST_CHARACTERS else None
    unit = UNITS.get((found["bracket"] or found["end"] or "").lower(), "") if found else ""
    return (found["name"], unit) if found and unit else (name, "")


def plain(name: str) -> str:
    """A name in lower case, letters and digits only."""
    return re.sub(r"[^a-z0-9]", "", name.lower())
