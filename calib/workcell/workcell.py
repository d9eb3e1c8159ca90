"""Cell of an arm as a value: the arm, the jig, the scanner's pose and field, what it looks at, and obstacles.

Either the scanner stands in the room and the arm carries the jig, or the arm carries the scanner and the jig stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Box
from calib.jig import Jig
from calib.kinematics.chain import Chain, nominal_chain
from calib.kinematics.robot import Robot
from calib.workcell.bodies.arm_bodies import ArmBodies
from calib.workcell.scan_field import BoxField, ScanField

_WIDER_DEG = 5.0  # than the measured directions is the cone from which the target can be seen
_WIDEST_DEG = 180.0


@dataclass(frozen=True)
class RoomTarget:
    """A target fixed in the room, and the cone of directions from which it can be seen."""

    place_mm: Array  # (3,) base frame
    outward: Array  # (3,) unit, base frame: the cone's axis, from the target to where it is seen from
    within_deg: float  # half the cone's opening

    def sees(self, eye_mm: Array) -> BoolArray:
        """Mask (N,): whether the target can be seen from places (N, 3), base frame."""
        sight = eye_mm - self.place_mm
        cosine = sight @ self.outward / np.maximum(np.linalg.norm(sight, axis=1), 1e-9)
        return cosine >= np.cos(np.radians(self.within_deg))


def seen_target(place_mm: Array, eye_mm: Array) -> RoomTarget:
    """Target at a place (3,) seen from places (N, 3): the cone around the mean direction, 5 deg wider than measured."""
    sight = eye_mm - place_mm
    sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9)
    outward = sight.mean(axis=0)
    outward /= max(float(np.linalg.norm(outward)), 1e-9)
    farthest_deg = float(np.degrees(np.arccos(np.clip(sight @ outward, -1.0, 1.0)).max()))
    return RoomTarget(place_mm, outward, min(farthest_deg + _WIDER_DEG, _WIDEST_DEG))


class InView(Protocol):
    """What an instrument of a plug-in has to see at a pose."""

    @property
    def note(self) -> str:
        """Sentence on what is asked for."""

    def shows_all(self, base_T_flange: Array) -> BoolArray:
        """(N,) whether all of it is seen, by poses of the flange."""

    def too_steep(self, base_T_flange: Array) -> BoolArray:
        """(N,) whether it is seen at too large an incidence."""


@dataclass(frozen=True, eq=False)
class Workcell:
    """Facts that decide whether a pose can be measured; an unknown fact is None and is not checked."""

    robot: Robot
    low: Array  # (n,) rad or mm: range of the joint commands
    high: Array
    jig: Jig | None  # None: a mirror or a ball, which is seen from everywhere
    tool_T_jig: Array  # (4, 4) apex and axis, z into the material
    base_T_scanner: Array | None  # (4, 4); None: not known, or on the flange
    field: ScanField | BoxField | None
    bodies: ArmBodies
    floor_z_mm: float | None = None  # base frame
    boxes: tuple[Box, ...] = ()
    least_manipulability: float = 0.0  # least over largest singular value of the Jacobian
    notes: tuple[str, ...] = ()  # what was assumed or measured, a sentence each
    flange_T_scanner: Array | None = None  # (4, 4) where the arm carries the scanner
    room_target: RoomTarget | None = None  # what a carried scanner looks at
    in_view: InView | None = None  # what an instrument of a plug-in has to see

    def scanner_at(self, chain: Chain) -> Array | None:
        """base_T_scanner (N, 4, 4) at N poses of the arm; None where it is not known."""
        if self.flange_T_scanner is not None:
            return chain.base_T_flange @ self.flange_T_scanner
        if self.base_T_scanner is None:
            return None
        return np.broadcast_to(self.base_T_scanner, (len(chain.base_T_frame), 4, 4))

    def chain(self, q: Array) -> Chain:
        """Frames of the arm at joints (N, n)."""
        return nominal_chain(self.robot, q)
