"""Cell of an arm as a value: the arm, the jig, the scanner's pose and field, and obstacles.

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
from calib.workcell.view_of_target import RoomTarget


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
