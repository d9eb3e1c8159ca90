"""Cell of an arm as a value: the arm, the jig, the scanner's pose and field, and obstacles."""

from __future__ import annotations

from dataclasses import dataclass

from calib.array_types import Array
from calib.dataset.dataset import Box
from calib.jig import Jig
from calib.kinematics.chain import Chain, forward
from calib.kinematics.robot import Robot
from calib.workcell.bodies.arm_bodies import ArmBodies
from calib.workcell.scan_field import BoxField, ScanField


@dataclass(frozen=True, eq=False)
class Workcell:
    """Facts that decide whether a pose can be measured; an unknown fact is None and is not checked."""

    robot: Robot
    low: Array  # (n,) rad or mm: range of the joint commands
    high: Array
    jig: Jig | None  # None: a mirror or a ball, which is seen from everywhere
    tool_T_jig: Array  # (4, 4) apex and axis, z into the material
    base_T_scanner: Array | None  # (4, 4)
    field: ScanField | BoxField | None
    bodies: ArmBodies
    floor_z_mm: float | None = None  # base frame
    boxes: tuple[Box, ...] = ()
    least_manipulability: float = 0.0  # least over largest singular value of the Jacobian
    notes: tuple[str, ...] = ()  # what was assumed or measured, a sentence each

    def chain(self, q: Array) -> Chain:
        """Frames of the arm at joints (N, n)."""
        return forward(self.robot.table, q, self.robot.is_revolute, self.robot.base_T_first)
