"""Circles of bolts by which a part is screwed to a robot's flange.

ISO 9409-1:2004, *Manipulating industrial robots - Mechanical interfaces - Plates*, names a flange by the diameter of
its bolt circle, the number of bolts and their thread: 50-4-M6. Clearance holes are those of ISO 273, medium; heads
those of socket head cap screws, ISO 4762.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from calib.extras.printed_parts.part import WALL_MM, PartError
from calib.extras.printed_parts.solid import Mesh, hull, ring_around

_THREADS = {  # of M: clearance hole, diameter and height of the head, mm
    3: (3.4, 5.5, 3.0),
    4: (4.5, 7.0, 4.0),
    5: (5.5, 8.5, 5.0),
    6: (6.6, 10.0, 6.0),
    8: (9.0, 13.0, 8.0),
    10: (11.0, 16.0, 10.0),
    12: (13.5, 18.0, 12.0),
}
_KNOWN = "|".join(map(str, _THREADS))
_DESIGNATION = re.compile(rf"(?:ISO\s*9409-1-)?(\d{{1,3}}(?:\.\d+)?)-([2-9]|1[0-2])-M({_KNOWN})", re.IGNORECASE)
HEAD_CLEARANCE_MM = 1.5
"""Room around the head of a bolt."""
STANDARD = "50-4-M6"
"""The bolt circle of most arms that carry 3 to 10 kg."""


@dataclass(frozen=True)
class BoltCircle:
    """Bolts at equal angles on a circle about the flange's axis, the first half a step from the x axis."""

    diameter_mm: float
    count: int
    thread: int  # 6 for M6

    @property
    def name(self) -> str:
        """Designation as ISO 9409-1 has it, without its number: 50-4-M6."""
        return f"{self.diameter_mm:g}-{self.count}-M{self.thread}"

    @property
    def hole_mm(self) -> float:
        """Diameter of a hole through which a bolt passes."""
        return _THREADS[self.thread][0]

    @property
    def head_mm(self) -> float:
        """Diameter of a bolt's head."""
        return _THREADS[self.thread][1]

    @property
    def head_height_mm(self) -> float:
        """Height of a bolt's head."""
        return _THREADS[self.thread][2]

    @property
    def plate_radius_mm(self) -> float:
        """Radius of a round plate that carries the bolts' heads whole."""
        return self.diameter_mm / 2 + self.head_mm / 2 + 2 * WALL_MM

    @property
    def free_radius_mm(self) -> float:
        """Radius of what may stand on the plate between the bolts' heads."""
        return self.diameter_mm / 2 - self.head_mm / 2 - HEAD_CLEARANCE_MM

    def holes(self, depth_mm: float) -> list[Mesh]:
        """What the bolts' holes cut out of a plate from the flange's plane to a height."""
        angles = 2 * np.pi * (np.arange(self.count) + 0.5) / self.count
        centres = self.diameter_mm / 2 * np.column_stack([np.cos(angles), np.sin(angles)])
        heights = (-1.0, depth_mm + 1.0)
        return [hull(*(ring_around(self.hole_mm / 2, z_mm, centre) for z_mm in heights)) for centre in centres]


def bolt_circle(designation: str) -> BoltCircle:
    """The circle that a designation such as 50-4-M6 or ISO 9409-1-50-4-M6 names: diameter in mm, bolts, thread.

    Raises:
        PartError: it is none, has a thread without known sizes, or bolts that meet each other or the axis.
    """
    match = _DESIGNATION.fullmatch(designation.strip())
    if match is None:
        raise PartError(
            f"bolts: found {designation!r}; expected DIAMETER-COUNT-THREAD, such as 50-4-M6 (ISO 9409-1), of 2 to 12 "
            f"bolts M{_KNOWN.replace('|', ', M')}"
        )
    made = BoltCircle(float(match[1]), int(match[2]), int(match[3]))
    apart = made.diameter_mm * np.sin(np.pi / made.count)
    if apart < made.head_mm + HEAD_CLEARANCE_MM:
        raise PartError(
            f"bolts: the heads of {made.name} meet: {made.head_mm:g} mm wide, {apart:.1f} mm apart; "
            "take fewer bolts, a smaller thread or a larger circle"
        )
    return made
