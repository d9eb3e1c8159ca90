"""Parts on a robot's flange: the three-faced corner that a scanner measures, and the stem of a ball for sockets.

Both stand on a round plate with the flange's bolt circle. The part's frame is the flange's: origin in its plane, z
along its axis, away from the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calib.extras.printed_parts.bolt_circle import STANDARD, BoltCircle, bolt_circle
from calib.extras.printed_parts.part import SIDES, WALL_MM, NamedPoint, PartError, PrintedPart, require_size
from calib.extras.printed_parts.solid import Mesh, at_height, circle, joined, loft, prism, triangle_loop
from calib.jig import Jig, jig_geometry

_KEY_MM = 10.0  # free height above a bolt's head, for the head of a ball-ended key
_LEAST_NECK_MM = 6.0  # radius
_BEYOND_CONTACT_MM = 1.0  # of a cup's rim beyond the circle on which the ball lies
_CUP_DEG = 90.0


@dataclass(frozen=True, kw_only=True)
class CornerJig:
    """Sizes of a convex corner of three square faces on a flange; checked when made. Raises PartError.

    The corner stands on a neck between the bolts, high enough to reach them with a key, and widens to its three faces
    at 45 degrees or steeper, which prints without supports.
    """

    edge_mm: float = 60.0  # of the three edges that leave the apex
    bolts: str = STANDARD
    standoff_mm: float = 40.0  # from the plate's top to where the neck begins to widen
    plate_mm: float = 8.0  # thickness of the plate on the flange

    def __post_init__(self) -> None:
        bolts = bolt_circle(self.bolts)
        require_size("edge", self.edge_mm, 10.0, 300.0)
        require_size("plate", self.plate_mm, 3.0, 50.0)
        require_size("standoff", self.standoff_mm, 0.0, 300.0)
        _require_neck(bolts)
        inner = bolts.diameter_mm / 2 - bolts.head_mm / 2
        free = bolts.head_height_mm + _KEY_MM
        if self._reach_mm > inner and self.standoff_mm < free:
            raise PartError(
                f"standoff: {self.standoff_mm:g} mm, and the bolts of {bolts.name} meet the faces, which reach "
                f"{self._reach_mm:.1f} mm from the axis, the heads {inner:.1f} mm; take {free:g} mm or more, or an "
                f"edge of {math.floor(inner / self._reach_mm * self.edge_mm)} mm"
            )

    @property
    def _reach_mm(self) -> float:
        """Distance of the edges' ends from the axis."""
        return self.edge_mm * math.sqrt(2 / 3)

    @property
    def _widening_mm(self) -> float:
        """Height over which the neck widens to the corner: 45 degrees where it widens most."""
        return max(abs(self._reach_mm - bolt_circle(self.bolts).free_radius_mm), _LEAST_NECK_MM)

    @property
    def apex_height_mm(self) -> float:
        """Height of the apex above the flange."""
        return self.plate_mm + self.standoff_mm + self._widening_mm + self.edge_mm / math.sqrt(3)

    def part(self) -> PrintedPart:
        """The jig as a part to print, in the flange's frame."""
        bolts = bolt_circle(self.bolts)
        neck = circle(bolts.free_radius_mm, SIDES)
        ends, _ = jig_geometry(Jig(edge_mm=self.edge_mm))  # z away from the scanner: the apex's side is turned up
        inradius = float(np.linalg.norm(ends[:, :2], axis=1).mean()) / 2
        apex = np.array([0.0, 0.0, self.apex_height_mm])
        base = at_height(triangle_loop(inradius, SIDES), self.apex_height_mm - float(ends[:, 2].mean()))
        loops = [at_height(neck, height) for height in (self.plate_mm / 2, self.plate_mm + self.standoff_mm)]
        solid = _on_flange(bolts, self.plate_mm, loft(*loops, base, np.tile(apex, (SIDES, 1))))
        sizes = {
            "edge_mm": self.edge_mm,
            "apex_height_mm": self.apex_height_mm,
            "neck_diameter_mm": 2 * bolts.free_radius_mm,
            "standoff_mm": self.standoff_mm,
            "plate_mm": self.plate_mm,
            "bolt_hole_mm": bolts.hole_mm,
        }
        point = NamedPoint("apex", (0.0, 0.0, self.apex_height_mm))
        return PrintedPart("corner", solid, sizes, (point,), bolts.name)


@dataclass(frozen=True, kw_only=True)
class BallStem:
    """Sizes of a stem with a cup into which a ball is glued; checked when made. Raises PartError.

    The cup is a cone of 90 degrees: a ball of radius R lies in it on a circle of radius R / sqrt(2), and its centre
    is as far above the cup's tip as the ball's radius times sqrt(2).
    """

    ball_mm: float = 20.0  # diameter
    bolts: str = STANDARD
    length_mm: float = 80.0  # from the flange to the ball's centre
    plate_mm: float = 8.0

    def __post_init__(self) -> None:
        bolts = bolt_circle(self.bolts)
        require_size("ball", self.ball_mm, 6.0, 100.0)
        require_size("plate", self.plate_mm, 3.0, 50.0)
        require_size("length", self.length_mm, 0.0)
        _require_neck(bolts)
        least = self.plate_mm + bolts.head_height_mm + self._cup_mm + self._centre_above_rim_mm
        if self.length_mm < least:
            raise PartError(
                f"length: {self.length_mm:g} mm from the flange to the ball's centre is too short for plate, bolts and "
                f"cup; take {math.ceil(least)} mm or more"
            )
        if self._end_mm > bolts.free_radius_mm:
            raise PartError(
                f"ball: the stem of {2 * self._end_mm:.1f} mm for a ball of {self.ball_mm:g} mm meets the bolts of "
                f"{bolts.name}, {2 * bolts.free_radius_mm:.1f} mm apart; take a smaller ball or a larger circle"
            )

    @property
    def _rim_mm(self) -> float:
        return self.ball_mm / 2 * math.cos(math.radians(_CUP_DEG / 2)) + _BEYOND_CONTACT_MM

    @property
    def _end_mm(self) -> float:
        """Radius of the stem's end, around the cup."""
        return self._rim_mm / math.cos(math.pi / SIDES) + WALL_MM

    @property
    def _centre_above_rim_mm(self) -> float:
        half = math.radians(_CUP_DEG / 2)
        return self.ball_mm / 2 / math.sin(half) - self._rim_mm / math.tan(half)

    @property
    def _cup_mm(self) -> float:
        """Depth of the cup."""
        return self._rim_mm / math.tan(math.radians(_CUP_DEG / 2))

    def part(self) -> PrintedPart:
        """The stem as a part to print, in the flange's frame."""
        bolts = bolt_circle(self.bolts)
        foot, end = circle(bolts.free_radius_mm, SIDES), circle(self._end_mm, SIDES)
        rim = circle(self._rim_mm, SIDES, around=True)
        top = self.length_mm - self._centre_above_rim_mm
        tip = at_height(np.zeros_like(rim), top - self._cup_mm)
        above = at_height(2.0 * rim, top + self._cup_mm)  # the cup's cone, twice as high
        body = loft(at_height(foot, self.plate_mm / 2), at_height(foot, self.plate_mm), at_height(end, top))
        solid = _on_flange(bolts, self.plate_mm, body, loft(tip, above))
        sizes = {
            "ball_mm": self.ball_mm,
            "length_mm": self.length_mm,
            "cup_diameter_mm": 2 * self._rim_mm,
            "plate_mm": self.plate_mm,
            "bolt_hole_mm": bolts.hole_mm,
        }
        point = NamedPoint("ball", (0.0, 0.0, self.length_mm))
        return PrintedPart("stem", solid, sizes, (point,), bolts.name)


def _require_neck(bolts: BoltCircle) -> None:
    if bolts.free_radius_mm < _LEAST_NECK_MM:
        raise PartError(
            f"bolts: the heads of {bolts.name} leave {max(0.0, 2 * bolts.free_radius_mm):.1f} mm between them, and a "
            f"neck needs {2 * _LEAST_NECK_MM:g} mm; take a larger circle or a smaller thread"
        )


def _on_flange(bolts: BoltCircle, plate_mm: float, body: Mesh, *less: Mesh) -> Mesh:
    """A round plate of this thickness with the bolts' holes and a body on it, less what is cut out of the body."""
    plate = prism(circle(bolts.plate_radius_mm, SIDES), 0.0, plate_mm)
    holes = [prism(hole, -1.0, plate_mm + 1.0) for hole in bolts.holes()]
    return joined([plate, body], [*holes, *less])
