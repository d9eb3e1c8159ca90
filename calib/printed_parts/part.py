"""A part to print: its solid, the points on it that an arm or a scanner meets, and its sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.errors import PartError
from calib.printed_parts.solid import Solid

WALL_MM = 1.6
"""Least wall between a hole and whatever is beside it: four lines of a common 0.4 mm nozzle."""
SIDES = 96
"""Sides of a polygon that stands for a circle: a chord of a 60 mm circle is 0.02 mm off."""
HOLE_SIDES = 48
"""Sides of the polygon of a hole or socket."""
_LARGEST_MM = 1000.0


@dataclass(frozen=True)
class NamedPoint:
    """A nominal point of a part by its name: the centre of a seated ball, or an apex."""

    name: str
    xyz_mm: tuple[float, float, float]


@dataclass(frozen=True)
class PrintedPart:
    """A part to print. What it is for is told by `calib.present.moves.printed_parts`."""

    kind: str  # "sockets", "corner" or "stem"
    solid: Solid
    sizes: Mapping[str, float]  # chosen and computed, each with its unit in its name
    points: tuple[NamedPoint, ...] = ()
    bolts: str | None = None  # designation of the bolt circle, ISO 9409-1

    def stl(self) -> bytes:
        """The part as binary STL, mm."""
        return binary_stl(self.solid, f"{self.kind}, mm, robot calibration inspector")


def require_size(name: str, value_mm: float, least_mm: float, most_mm: float = _LARGEST_MM) -> None:
    """Raise PartError where a size is no number or out of the range that can be printed."""
    if not math.isfinite(value_mm) or not least_mm <= value_mm <= most_mm:
        raise PartError(f"{name}: found {value_mm:g} mm; {least_mm:g} to {most_mm:g} mm can be printed")


_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("free", "<u2")])
_HEADER = 80  # bytes


def binary_stl(solid: Solid, name: str) -> bytes:
    """A solid as binary STL, mm; the header is `name` in ASCII, cut to 80 bytes.

    Then the number of triangles, and of each its normal, three corners and two free bytes, little-endian (3D Systems,
    *StereoLithography Interface Specification*). The form has no unit; slicing programs take millimetres.
    """
    corners = solid.triangles_mm
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows = np.zeros(len(corners), dtype=_TRIANGLE)
    rows["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    rows["corners"] = corners
    header = name.encode("ascii", errors="replace")[:_HEADER].ljust(_HEADER)
    return header + np.uint32(len(rows)).astype("<u4").tobytes() + rows.tobytes()
