"""Names of columns: their units, in every spelling, and what is left of a name without signs and units."""

from __future__ import annotations

import math
import re


def listed(text: str) -> tuple[str, ...]:
    """Words of a line of a table of words."""
    return tuple(text.split())


_SPELLINGS = {
    "deg": "deg degree degrees ° grad degré degrés degre degres gradi grados 度",
    "rad": "rad radian radians radiant 弧度 ラジアン",
    "gon": "gon gons",
    "mm": "mm millimeter millimeters millimetre millimetres millimètres 毫米 ミリ",
    "m": "m meter metre meters metres mètre mètres 米",
    "cm": "cm",
    "in": "in inch inches zoll pouce pouces インチ",
    "um": "um µm μm",
    "kg": "kg",
    "s": "s sec",
    "c": "c °c degc",
}
UNITS = {spelling: unit for unit, spellings in _SPELLINGS.items() for spelling in listed(spellings)}
"""Spellings of units, and the name of each unit in this program."""
LENGTHS_MM = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "in": 25.4, "um": 1e-3}
ANGLES_RAD = {"deg": math.radians(1.0), "rad": 1.0}
SCALES = ANGLES_RAD | LENGTHS_MM
"""Units of joints in rad and mm."""
GON_RAD = math.pi / 200.0
MOST_CHARACTERS = 200  # of a column name that is parsed
_UNIT = re.compile(
    r"^(?P<name>.*?)(?:[\s_]*[\[(\uff08\u3010]\s*(?P<bracket>[^\])\uff09\u3011]+?)\s*[\])\uff09\u3011]"
    r"|[\s_.]+(?P<end>[^\s_.\d]+))$"
)


def split_unit(name: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit; "" where the name has no known unit."""
    found = _UNIT.match(name.strip()) if len(name) <= MOST_CHARACTERS else None
    unit = UNITS.get((found["bracket"] or found["end"] or "").lower(), "") if found else ""
    return (found["name"], unit) if found and unit else (name, "")


def plain(name: str) -> str:
    """A name in lower case, letters and digits of any script only."""
    return "".join(c for c in name.lower() if c.isalnum())
