"""A part to print: its solid, the points on it that an arm or a scanner meets, and its sizes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from calib.errors import CalibError
from calib.extras.printed_parts.solid import Mesh

WALL_MM = 1.6
"""Least wall between a hole and whatever is beside it: four lines of a common 0.4 mm nozzle."""
_LARGEST_MM = 1000.0


class PartError(CalibError):
    """A part to print cannot have the sizes that are asked for."""


@dataclass(frozen=True)
class NamedPoint:
    """A nominal point of a part by its name: the centre of a seated ball, or an apex."""

    name: str
    xyz_mm: tuple[float, float, float]


@dataclass(frozen=True)
class PrintedPart:
    """A part to print. What it is for is told by `presentation.py`."""

    kind: str  # "sockets", "corner" or "stem"
    solid: Mesh
    points: tuple[NamedPoint, ...] = ()
    bolts: str | None = None  # designation of the bolt circle, ISO 9409-1

    def stl(self) -> bytes:
        """The part as binary STL, mm."""
        made: bytes = self.solid.export(file_type="stl")
        return made


def require_size(name: str, value_mm: float, least_mm: float, most_mm: float = _LARGEST_MM) -> None:
    """Raise PartError where a size is no number or out of the range that can be printed."""
    if not math.isfinite(value_mm) or not least_mm <= value_mm <= most_mm:
        raise PartError(f"{name}: found {value_mm:g} mm; {least_mm:g} to {most_mm:g} mm can be printed")
