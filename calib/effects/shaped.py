"""Effects that are a displacement of the arm times a number at each pose: a step in time, a dent along an angle.

Such a family has many members, one for each pose or place where the cause may be, of which few are present. Members of
one `Displacement` differ by their shapes alone, so all their columns follow from the displacement's few.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.array_types import Array
from calib.effects.effect import CatalogueEffect, Parameter
from calib.effects.state import RobotState


class Displacement(Protocol):
    """A displacement linear in W amounts; instances that compare equal displace alike."""

    @property
    def width(self) -> int:
        """Number W of amounts."""
        ...

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """The state displaced by amounts (N, W) at each pose, linearly in each amount."""
        ...


class ShapedEffect(CatalogueEffect):
    """An effect whose parameter l * W + w, times shape l at a pose, is amount w of the displacement there."""

    linear = True

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters, one for each shape and amount."""

    @property
    @abstractmethod
    def displacement(self) -> Displacement:
        """The displacement that the parameters scale."""

    @abstractmethod
    def shapes(self, state: RobotState) -> Array:
        """Shapes of the effect over the poses, without unit: (N, L)."""

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """State displaced at each pose by shapes times values."""
        sizes = np.array(list(values.values())).reshape(-1, self.displacement.width)  # (L, W)
        return self.displacement.act(state, self.shapes(state) @ sizes)


@dataclass(frozen=True)
class JointOffset:
    """An error of a joint's position: rad, or mm of a prismatic joint."""

    joint: int
    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """State with the joint's error added."""
        return state.add_joint_error(self.joint, amounts[:, 0])


@dataclass(frozen=True)
class TargetShift:
    """A shift of the target along the flange's x, y and z: mm."""

    width = 3

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """State with the target displaced."""
        rotation = state.loaded.chain.base_T_flange[:, :3, :3]
        return state.displace(np.einsum("nij,nj->ni", rotation, amounts))


@dataclass(frozen=True)
class ScannerMotion:
    """A rigid motion of the reported points: along the scanner's axes, mm, and about a point of its field, rad."""

    centre_mm: tuple[float, float, float]
    width = 6

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """State with the reported points moved."""
        if state.seen is None:
            return state
        arm = state.seen.scanner_mm - np.array(self.centre_mm)
        turn = amounts[:, 3:]
        return state.displace_in_scanner(amounts[:, :3] + np.cross(turn, arm)).turn_in_scanner(turn)


@dataclass(frozen=True)
class BaseTilt:
    """A tilt of the base about its x and y under a unit of the overturning moment: rad/Nm."""

    width = 2

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """State with the base turned."""
        moment = state.loaded.gravity.moment_about(np.zeros((len(state.poses), 3)), 0)
        return state.turn_base(moment * np.column_stack([amounts, np.zeros(len(amounts))]))


@dataclass(frozen=True)
class Growth:
    """A growth of all lengths: a and d times 1 + amount."""

    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """State with the lengths scaled."""
        nominal = state.robot.table
        for frame in range(len(nominal)):
            for column, kind in ((0, "a"), (2, "d")):
                if nominal[frame, column] != 0.0:
                    state = state.add_link_error(frame, kind, amounts[:, 0] * nominal[frame, column])
        return state
