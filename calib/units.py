"""Units of length of input files other than the millimetre, which is the unit of all lengths here."""

from __future__ import annotations

UNITS_MM = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4, "micrometres": 0.001}
"""Millimetres in one of each unit."""
