"""Effects that are one displacement of the arm times a number at each pose: a step in time, a dent along an angle.

A family of these has many members, one for each pose or place where it may be, and few of them carry it. Members of one
`Displacement` differ by their shapes alone, so all their columns follow from the displacement's few.
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
    """What a unit of each of W amounts moves. Values compare equal where they move the same."""

    @property
    def width(self) -> int:
        """W."""
        ...

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """The state displaced by amounts (N, W) at each pose, in proportion to each."""
        ...


class ShapedEffect(CatalogueEffect):
    """An effect of which parameter l * W + w times shape l of a pose is the displacement's amount w."""

    linear = True

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each shape and amount."""

    @property
    @abstractmethod
    def displacement(self) -> Displacement:
        """What is moved."""

    @abstractmethod
    def shapes(self, state: RobotState) -> Array:
        """(N, L) how much of it there is at each pose."""

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """The displacement, as large at each pose as shapes and values say."""
        sizes = np.array(list(values.values())).reshape(-1, self.displacement.width)  # (L, W)
        return self.displacement.act(state, self.shapes(state) @ sizes)


@dataclass(frozen=True)
class JointOffset:
    """A joint's angle is off: rad, or mm of a prismatic joint."""

    joint: int
    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """The joint's error added."""
        return state.add_joint_error(self.joint, amounts[:, 0])


@dataclass(frozen=True)
class TargetShift:
    """The target is shifted along the flange's x, y and z: mm."""

    width = 3

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """The target displaced."""
        rotation = state.loaded.chain.base_T_flange[:, :3, :3]
        return state.displace(np.einsum("nij,nj->ni", rotation, amounts))


@dataclass(frozen=True)
class ScannerMotion:
    """What the scanner reports moves as a rigid body: along its axes, mm, and about a point of its field, rad."""

    centre_mm: tuple[float, float, float]
    width = 6

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """What is reported, moved."""
        if state.seen is None:
            return state
        arm = state.seen.scanner_mm - np.array(self.centre_mm)
        turn = amounts[:, 3:]
        return state.displace_in_scanner(amounts[:, :3] + np.cross(turn, arm)).turn_in_scanner(turn)


@dataclass(frozen=True)
class BaseTilt:
    """The base tilts about its x and y under a unit of the overturning moment: rad/Nm."""

    width = 2

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """The base turned."""
        moment = state.loaded.gravity.moment_about(np.zeros((len(state.poses), 3)), 0)
        return state.turn_base(moment * np.column_stack([amounts, np.zeros(len(amounts))]))


@dataclass(frozen=True)
class Growth:
    """All lengths grow: a and d times 1 + amount."""

    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Lengths scaled."""
        nominal = state.robot.table
        for frame in range(len(nominal)):
            for column, kind in ((0, "a"), (2, "d")):
                if nominal[frame, column] != 0.0:
                    state = state.add_link_error(frame, kind, amounts[:, 0] * nominal[frame, column])
        return state
