"""Parts on a robot's flange: the three-faced corner that a scanner measures, and the stem of a ball for sockets.

Both stand on a round plate with the flange's bolt circle. The part's frame is the flange's: origin in its plane, z
along its axis, away from the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calib.extras.printed_parts.bolt_circle import STANDARD, BoltCircle, bolt_circle
from calib.extras.printed_parts.part import WALL_MM, NamedPoint, PartError, PrintedPart, require_size
from calib.extras.printed_parts.solid import SIDES, Mesh, hull, joined, ring
from calib.jig import Jig, jig_geometry

PLATE_MM = 8.0  # thickness of the plate on the flange
STANDOFF_MM = 40.0  # from the plate's top to where a corner's neck begins to widen: room for a key at the bolts
_LEAST_NECK_MM = 6.0  # radius
_BEYOND_CONTACT_MM = 1.0  # of a cup's rim beyond the circle on which the ball lies


@dataclass(frozen=True, kw_only=True)
class CornerJig:
    """Sizes of a convex corner of three square faces on a flange; checked when made. Raises PartError.

    The corner stands on a neck between the bolts, high enough to reach them with a key, and widens to its three faces
    at 45 degrees or steeper, which prints without supports.
    """

    edge_mm: float = 60.0  # of the three edges that leave the apex
    bolts: str = STANDARD

    def __post_init__(self) -> None:
        require_size("edge", self.edge_mm, 10.0, 300.0)
        _require_neck(bolt_circle(self.bolts))

    def part(self) -> PrintedPart:
        """The jig as a part to print, in the flange's frame."""
        bolts = bolt_circle(self.bolts)
        reach_mm = self.edge_mm * math.sqrt(2 / 3)  # of the edges' ends from the axis
        widening_mm = max(abs(reach_mm - bolts.free_radius_mm), _LEAST_NECK_MM)  # 45 degrees where it widens most
        neck_mm = PLATE_MM + STANDOFF_MM
        apex_mm = neck_mm + widening_mm + self.edge_mm / math.sqrt(3)
        apex = np.array([[0.0, 0.0, apex_mm]])
        x, y, below = jig_geometry(Jig(edge_mm=self.edge_mm))[0].T  # of the edges' ends, z away from the scanner
        ends = apex + np.column_stack([-y, x, -below])
        top = ring(bolts.free_radius_mm, neck_mm)
        body = [hull(ring(bolts.free_radius_mm, PLATE_MM / 2), top), hull(top, ends), hull(ends, apex)]
        point = NamedPoint("apex", (0.0, 0.0, apex_mm))
        return PrintedPart("corner", _on_flange(bolts, body), (point,), bolts.name)


@dataclass(frozen=True, kw_only=True)
class BallStem:
    """Sizes of a stem with a cup into which a ball is glued; checked when made. Raises PartError.

    The cup is a cone of 90 degrees: a ball of radius R lies in it on a circle of radius R / sqrt(2), and its centre
    is as far above the cup's tip as the ball's radius times sqrt(2).
    """

    ball_mm: float = 20.0  # diameter
    bolts: str = STANDARD
    length_mm: float = 80.0  # from the flange to the ball's centre

    def __post_init__(self) -> None:
        bolts = bolt_circle(self.bolts)
        require_size("ball", self.ball_mm, 6.0, 100.0)
        require_size("length", self.length_mm, 0.0)
        _require_neck(bolts)
        least = PLATE_MM + bolts.head_height_mm + self.ball_mm / math.sqrt(2)
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
        """Radius of the cup's rim, and its depth."""
        return self.ball_mm / math.sqrt(8) + _BEYOND_CONTACT_MM

    @property
    def _end_mm(self) -> float:
        """Radius of the stem's end, around the cup."""
        return self._rim_mm / math.cos(math.pi / SIDES) + WALL_MM

    def part(self) -> PrintedPart:
        """The stem as a part to print, in the flange's frame."""
        bolts, rim_mm = bolt_circle(self.bolts), self._rim_mm
        tip_mm = self.length_mm - self.ball_mm / math.sqrt(2)
        foot = [ring(bolts.free_radius_mm, height) for height in (PLATE_MM / 2, PLATE_MM)]
        body = [hull(*foot), hull(foot[1], ring(self._end_mm, tip_mm + rim_mm))]
        cup = hull(
            np.array([[0.0, 0.0, tip_mm]]), ring(2.0 * rim_mm / math.cos(math.pi / SIDES), tip_mm + 2.0 * rim_mm)
        )
        point = NamedPoint("ball", (0.0, 0.0, self.length_mm))
        return PrintedPart("stem", _on_flange(bolts, body, cup), (point,), bolts.name)


def _require_neck(bolts: BoltCircle) -> None:
    if bolts.free_radius_mm < _LEAST_NECK_MM:
        raise PartError(
            f"bolts: the heads of {bolts.name} leave {max(0.0, 2 * bolts.free_radius_mm):.1f} mm between them, and a "
            f"neck needs {2 * _LEAST_NECK_MM:g} mm; take a larger circle or a smaller thread"
        )


def _on_flange(bolts: BoltCircle, body: list[Mesh], *less: Mesh) -> Mesh:
    """A round plate with the bolts' holes and a body on it, less what is cut out of the body."""
    plate = hull(*(ring(bolts.plate_radius_mm, height) for height in (0.0, PLATE_MM)))
    return joined([plate, *body], [*bolts.holes(PLATE_MM), *less])
