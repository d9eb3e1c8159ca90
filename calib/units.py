"""Units of length that files come in besides the millimetre, which is the unit of all lengths here."""

from __future__ import annotations

UNITS_MM = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 0.001}
"""How many millimetres each has."""
