"""A plate of sockets in which a ball on the arm comes to rest at points that are known relative to each other.

A socket is a cone of 90 degrees. A ball of radius R touches it at the distance R / sqrt(2) from its axis, and its
centre lies R sqrt(2) above the tip of the cone. A socket whose rim is rho wide (half) at the plate's top has its tip
rho below the top, so the centre's height is h = R sqrt(2) - rho.

All sockets are alike, so h and whatever the printer adds to every socket is the same at each, and drops out of a fit
that finds where the plate stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np

from calib.extras.printed_parts.part import WALL_MM, NamedPoint, PartError, PrintedPart, require_size
from calib.extras.printed_parts.solid import HOLE_SIDES, at_height, hull, joined, ring, ring_around

_BEYOND_CONTACT_MM = 1.0  # of the rim beyond the circle on which the ball rests, so that it never rests on the rim
_FLOOR_SHARE = 0.5  # height of a socket's floor above its tip, of the height of the ball's lowest point there
_BELOW_MM = 4  # of the plate below its sockets, at the most
_MARGIN_MM = 14.0  # around the sockets' cells, for clamps, bolts and the mark
_MOUNT_HOLE_MM = 5.5  # of the four holes in the plate's corners
_MARK_MM, _MARK_DEEP_MM = 4.0, 1.0  # dimple beside the first socket
MOST_COLUMNS = len(ascii_uppercase)
_MOST_ROWS = 26


@dataclass(frozen=True, kw_only=True)
class SocketPlate:
    """Sizes of a plate of `columns` by `rows` sockets; checked when made. Raises PartError."""

    columns: int = 2
    rows: int = 1
    pitch_mm: float = 50.0  # between the centres of neighbours, both ways
    ball_mm: float = 20.0  # diameter

    def __post_init__(self) -> None:
        if not (1 <= self.columns <= MOST_COLUMNS and 1 <= self.rows <= _MOST_ROWS):
            raise PartError(
                f"sockets: found {self.columns} x {self.rows}; 1 to {MOST_COLUMNS} columns and 1 to {_MOST_ROWS} rows"
            )
        require_size("ball", self.ball_mm, 4.0, 100.0)
        require_size("pitch", self.pitch_mm, 5.0)
        wide_mm = 2 * self.rim_mm / math.cos(math.pi / HOLE_SIDES)
        if wide_mm + WALL_MM > self.pitch_mm:
            raise PartError(
                f"pitch: {self.pitch_mm:g} mm, but sockets for a ball of {self.ball_mm:g} mm are {wide_mm:.1f} mm "
                f"wide and overlap; take {math.ceil(wide_mm + WALL_MM)} mm or more, or a smaller ball"
            )
        require_size("length of the plate", self.pitch_mm * max(self.columns, self.rows) + 2 * _MARGIN_MM, 0.0)

    @property
    def rim_mm(self) -> float:
        """Radius rho of a socket's rim, beyond the circle on which the ball rests."""
        return self.ball_mm / math.sqrt(8) + _BEYOND_CONTACT_MM

    @property
    def centre_height_mm(self) -> float:
        """Height h of a seated ball's centre above the plate's top."""
        return self.ball_mm / math.sqrt(2) - self.rim_mm

    @property
    def socket_depth_mm(self) -> float:
        """Depth of a socket's floor below the plate's top."""
        return self.rim_mm - _FLOOR_SHARE * self.ball_mm / 2 * (math.sqrt(2) - 1)

    def centres(self) -> tuple[NamedPoint, ...]:
        """Nominal centres of the seated ball, mm: A1 the origin, B1 along x, A2 along y, z away from the plate."""
        return tuple(
            NamedPoint(f"{ascii_uppercase[i]}{j + 1}", (i * self.pitch_mm, j * self.pitch_mm, 0.0))
            for j in range(self.rows)
            for i in range(self.columns)
        )

    def part(self) -> PrintedPart:
        """The plate as a part to print, in the frame of `centres`."""
        thickness_mm = math.floor(self.socket_depth_mm + 1e-9) + _BELOW_MM
        top_mm, depth_mm = -self.centre_height_mm, self.socket_depth_mm  # the seated balls' centres are at z = 0
        bottom_mm = top_mm - thickness_mm
        first = -self.pitch_mm / 2 - _MARGIN_MM
        size = 2 * _MARGIN_MM + self.pitch_mm * np.array([self.columns, self.rows])
        cells = np.array([(i, j) for i in (0, 1) for j in (0, 1)])
        outline = [at_height(first + cells * size, z) for z in (bottom_mm, top_mm)]
        middle_mm = first + _MARGIN_MM / 2  # of the margin, in which holes and mark are
        corners = middle_mm + cells * (size - _MARGIN_MM)
        mark = [ring(_MARK_MM / 4 * k, top_mm + (k - 2) * _MARK_DEEP_MM, HOLE_SIDES) for k in (1, 3)]
        pits = [
            *(
                hull(*(ring_around(self.rim_mm + rise, top_mm + rise, point.xyz_mm) for rise in (-depth_mm, depth_mm)))
                for point in self.centres()
            ),
            hull(*mark).apply_translation([middle_mm, 0.0, 0.0]),
            *(
                hull(*(ring_around(_MOUNT_HOLE_MM / 2, z, corner) for z in (bottom_mm - 1.0, top_mm + 1.0)))
                for corner in corners
            ),
        ]
        return PrintedPart("sockets", joined([hull(*outline)], pits), self.centres())
