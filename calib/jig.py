"""The jig that the scanner looks at: three faces that meet in one apex (Jang 2025, section 2)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Jig:
    """A trihedral corner.

    `edge_mm` is the length of each of the three edges that leave the apex. `convex` is true where the apex points
    at the scanner (a corner of a solid), false for the inside of a box. `face_angles_deg` are the angles between
    faces 1-2, 2-3 and 3-1; `certified` says that they were measured well enough to fit the faces as one rigid body.
    """

    shape: str = "trihedral"
    edge_mm: float = 60.0
    convex: bool = True
    face_angles_deg: tuple[float, float, float] = (90.0, 90.0, 90.0)
    certified: bool = False
