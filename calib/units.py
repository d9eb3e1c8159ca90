"""Units of length that input files may have besides the millimetre, the unit of all lengths in this package."""

from __future__ import annotations

UNITS_MM = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 0.001}
"""Millimetres in one of each unit."""
