"""A plate of sockets in which a ball on the arm comes to rest at points that are known relative to each other.

A socket is a cone, or three flat faces at the same slope, of full angle theta. A ball of radius R touches it at the
distance R cos(theta/2) from its axis, and its centre lies R / sin(theta/2) above the tip of the cone. A socket whose
rim is rho wide (half) at the plate's top has its tip rho / tan(theta/2) below the top, so the centre's height is

    h = R / sin(theta/2) - rho / tan(theta/2).

All sockets are alike, so h and whatever the printer adds to every socket is the same at each, and drops out of a fit
that finds where the plate stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np

from calib.array_types import Array
from calib.extras.printed_parts.part import HOLE_SIDES, WALL_MM, NamedPoint, PartError, PrintedPart, require_size
from calib.extras.printed_parts.solid import Mesh, at_height, circle, joined, loft, prism, triangle_loop

CONE, FACES = "cone", "faces"
SOCKET_SHAPES = (CONE, FACES)
_BEYOND_CONTACT_MM = 1.0  # of the rim beyond the circle on which the ball rests, so that it never rests on the rim
_FLOOR_SHARE = 0.5  # height of a socket's floor above its tip, of the height of the ball's lowest point there
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
    cone_deg: float = 90.0  # full angle of a socket
    shape: str = CONE
    margin_mm: float = 14.0  # around the sockets' cells, for clamps, bolts and the mark
    mount_hole_mm: float = 5.5  # of the four holes in the plate's corners; 0 for none
    thickness_mm: float | None = None  # None: 3 mm below the sockets

    def __post_init__(self) -> None:
        if not (1 <= self.columns <= MOST_COLUMNS and 1 <= self.rows <= _MOST_ROWS):
            raise PartError(
                f"sockets: found {self.columns} x {self.rows}; 1 to {MOST_COLUMNS} columns and 1 to {_MOST_ROWS} rows"
            )
        if self.shape not in SOCKET_SHAPES:
            raise PartError(f"socket shape: found {self.shape!r}; expected {' or '.join(SOCKET_SHAPES)}")
        require_size("ball", self.ball_mm, 4.0, 100.0)
        require_size("pitch", self.pitch_mm, 5.0)
        require_size("margin", self.margin_mm, _MARK_MM + 2 * WALL_MM, 200.0)
        if not 60.0 <= self.cone_deg <= 120.0:
            raise PartError(f"cone: found {self.cone_deg:g} degrees; 60 to 120 hold a ball and let it go again")
        if self.centre_height_mm <= 0:
            raise PartError(
                f"ball: {self.ball_mm:g} mm sinks into a socket of {self.cone_deg:g} degrees; take a larger ball or "
                "angle"
            )
        reach = self._rim().max(axis=0) - self._rim().min(axis=0)
        # A socket of faces reaches further on one side of its axis than on the other.
        needed = 2 * float(np.abs(self._rim()).max()) + WALL_MM
        if needed > self.pitch_mm:
            raise PartError(
                f"pitch: {self.pitch_mm:g} mm, but sockets for a ball of {self.ball_mm:g} mm are {reach.max():.1f} mm "
                f"wide and overlap; take {math.ceil(needed)} mm or more, or a smaller ball"
            )
        if self.mount_hole_mm != 0.0:
            require_size("mount hole", self.mount_hole_mm, 2.0, self.margin_mm - 2 * WALL_MM)
        require_size("thickness", self.plate_mm, self.socket_depth_mm + WALL_MM, 200.0)
        length = self.pitch_mm * max(self.columns, self.rows) + 2 * self.margin_mm
        require_size("length of the plate", length, 0.0)

    @property
    def _half_rad(self) -> float:
        return math.radians(self.cone_deg) / 2

    @property
    def contact_mm(self) -> float:
        """Distance of the points of contact from a socket's axis, R cos(theta/2)."""
        return self.ball_mm / 2 * math.cos(self._half_rad)

    @property
    def rim_mm(self) -> float:
        """Distance rho of a socket's rim from its axis: the radius of a cone's, of faces the nearest point."""
        return self.contact_mm + _BEYOND_CONTACT_MM

    @property
    def centre_height_mm(self) -> float:
        """Height h of a seated ball's centre above the plate's top."""
        return self.ball_mm / 2 / math.sin(self._half_rad) - self.rim_mm / math.tan(self._half_rad)

    @property
    def socket_depth_mm(self) -> float:
        """Depth of a socket's floor below the plate's top."""
        return self.rim_mm / math.tan(self._half_rad) - self._floor_above_tip_mm

    @property
    def _floor_above_tip_mm(self) -> float:
        return _FLOOR_SHARE * self.ball_mm / 2 * (1 / math.sin(self._half_rad) - 1)

    @property
    def plate_mm(self) -> float:
        """Thickness of the plate."""
        return math.ceil(self.socket_depth_mm + 3.0) if self.thickness_mm is None else self.thickness_mm

    def centres(self) -> tuple[NamedPoint, ...]:
        """Nominal centres of the seated ball, mm: A1 the origin, B1 along x, A2 along y, z away from the plate."""
        return tuple(
            NamedPoint(f"{ascii_uppercase[i]}{j + 1}", (i * self.pitch_mm, j * self.pitch_mm, 0.0))
            for j in range(self.rows)
            for i in range(self.columns)
        )

    def _rim(self) -> Array:
        """Outline (N, 2) of a socket at the plate's top about its axis; a ball touches every side's slope."""
        if self.shape == FACES:
            return triangle_loop(self.rim_mm, HOLE_SIDES)
        return circle(self.rim_mm, HOLE_SIDES, around=True)

    def part(self) -> PrintedPart:
        """The plate as a part to print, in the frame of `centres`."""
        top_mm = -self.centre_height_mm  # the seated balls' centres are at z = 0
        bottom_mm = top_mm - self.plate_mm
        first = -self.pitch_mm / 2 - self.margin_mm
        x_mm, y_mm = (2 * self.margin_mm + count * self.pitch_mm for count in (self.columns, self.rows))
        outline = np.array([[first, first], [first + x_mm, first], [first + x_mm, first + y_mm], [first, first + y_mm]])
        share = self._floor_above_tip_mm * math.tan(self._half_rad) / self.rim_mm
        pits = [_pit(self._rim(), share, self.socket_depth_mm, point.xyz_mm[:2], top_mm) for point in self.centres()]
        middle_mm = first + self.margin_mm / 2  # of the margin, in which holes and mark are
        mark = circle(_MARK_MM / 2, HOLE_SIDES)
        pits.append(_pit(mark, 0.5, _MARK_DEEP_MM, (middle_mm, 0.0), top_mm))
        if self.mount_hole_mm:
            for x in (middle_mm, middle_mm + x_mm - self.margin_mm):
                for y in (middle_mm, middle_mm + y_mm - self.margin_mm):
                    hole = circle(self.mount_hole_mm / 2, HOLE_SIDES, (x, y), around=True)
                    pits.append(prism(hole, bottom_mm - 1.0, top_mm + 1.0))
        solid = joined([prism(outline, bottom_mm, top_mm)], pits)
        sizes = {
            "pitch_mm": self.pitch_mm,
            "ball_mm": self.ball_mm,
            "cone_deg": self.cone_deg,
            "centre_height_mm": self.centre_height_mm,
            "contact_diameter_mm": 2 * self.contact_mm,
            "socket_depth_mm": self.socket_depth_mm,
            "thickness_mm": self.plate_mm,
        }
        return PrintedPart("sockets", solid, sizes, self.centres())


def _pit(rim: Array, share: float, depth_mm: float, centre_mm: tuple[float, ...], top_mm: float) -> Mesh:
    """What a pit cuts out of a plate: its floor is the rim about the centre, made smaller by `share`."""
    centre = np.array(centre_mm)
    floor = at_height(centre + share * rim, top_mm - depth_mm)
    above = at_height(centre + (2.0 - share) * rim, top_mm + depth_mm)
    return loft(floor, above)
