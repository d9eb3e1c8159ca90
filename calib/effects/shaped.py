"""Effects that scale a displacement of the arm by a number at each pose: a step in time, a dent along an angle.

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


def turned_end(state: RobotState, link: int, turn_rad: Array) -> RobotState:
    """Robot state with a link's end turned by small angles (N, 3) about the axes of the frame at it.

    These are alpha and beta of the link's row and theta of the next one.
    """
    turned = state.add_link_error(link, "alpha", turn_rad[:, 0]).add_link_error(link, "beta", turn_rad[:, 1])
    return turned.add_link_error(link + 1, "theta", turn_rad[:, 2])


def tilted_axis(state: RobotState, joint: int, about_x_rad: Array, about_y_rad: Array) -> RobotState:
    """Robot state with a joint's axis tilted by small angles (N,) about x and y of the frame that carries the joint."""
    if joint == 0:
        return state.turn_base(np.column_stack([about_x_rad, about_y_rad, np.zeros(len(about_x_rad))]))
    # Ry is the last factor of the row before, so beta turns about the y axis that this joint starts from; alpha's axis
    # is that frame's x where beta is small.
    before = joint - 1
    return state.add_link_error(before, "alpha", about_x_rad).add_link_error(before, "beta", about_y_rad)


class Displacement(Protocol):
    """A displacement of the robot state that is linear in W amounts; equal instances displace equally."""

    @property
    def width(self) -> int:
        """Number W of the displacement's amounts."""
        ...

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state displaced at each pose by amounts (N, W)."""
        ...


class ShapedEffect(CatalogueEffect):
    """Effect that displaces the arm by a sum over shapes: shape (a number per pose) times the amounts to be fitted."""

    linear = True

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the effect, one for each pair of shape and amount."""

    @property
    @abstractmethod
    def displacement(self) -> Displacement:
        """Displacement that the effect's parameters scale."""

    @abstractmethod
    def shapes(self, state: RobotState) -> Array:
        """Dimensionless factors (N, L) of the displacement at N poses, one column per shape."""

    def apply(self, state: RobotState, **values: float) -> RobotState:
        """Robot state displaced at each pose by shapes times parameter values."""
        sizes = np.array(list(values.values())).reshape(-1, self.displacement.width)  # (L, W)
        return self.displacement.act(state, self.shapes(state) @ sizes)


@dataclass(frozen=True)
class JointOffset:
    """An error of a joint's position: rad, or mm of a prismatic joint."""

    joint: int
    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the joint's error added."""
        return state.add_joint_error(self.joint, amounts[:, 0])


@dataclass(frozen=True)
class JointLaw(ShapedEffect):
    """Effect that errs the position of one joint by a sum of shapes, each a number per pose, times its parameters."""

    joint: int

    @property
    def displacement(self) -> JointOffset:
        """An error of the joint's position."""
        return JointOffset(self.joint)


@dataclass(frozen=True)
class TargetShift:
    """A shift of the target along the flange's x, y and z: mm."""

    width = 3

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the target displaced."""
        rotation = state.loaded.chain.base_T_flange[:, :3, :3]
        return state.displace(np.einsum("nij,nj->ni", rotation, amounts))


@dataclass(frozen=True)
class ScannerMotion:
    """A rigid motion of the reported points: along the scanner's axes, mm, and about a point of its field, rad."""

    centre_mm: tuple[float, float, float]
    width = 6

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the reported points moved."""
        if state.seen is None:
            return state
        arm = state.seen.scanner_mm - np.array(self.centre_mm)
        turn = amounts[:, 3:]
        return state.displace_in_scanner(amounts[:, :3] + np.cross(turn, arm)).turn_in_scanner(turn)


@dataclass(frozen=True)
class ScannerScaling:
    """A scaling of the reported points from the scanner's origin, relative."""

    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the reported points moved along their lines of sight."""
        return state if state.seen is None else state.displace_in_scanner(amounts * state.seen.scanner_mm)


@dataclass(frozen=True)
class BaseTilt:
    """A tilt of the base about its x and y under a unit of the overturning moment: rad/Nm."""

    width = 2

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the base turned."""
        moment = state.loaded.gravity.moment_about(np.zeros((len(state.poses), 3)), 0)
        return state.turn_base(moment * np.column_stack([amounts, np.zeros(len(amounts))]))


@dataclass(frozen=True)
class PayloadDeflection:
    """Joints that give way to a mass at the flange: for each the compliance times the mass, rad kg/Nm."""

    joints: tuple[int, ...]  # revolute

    @property
    def width(self) -> int:
        return len(self.joints)

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with each joint turned by the torque of 1 kg times its amount."""
        gravity = state.loaded.gravity
        for k, joint in enumerate(self.joints):
            state = state.add_joint_error(joint, amounts[:, k] * gravity.held_torque(joint))
        return state


@dataclass(frozen=True)
class LinkBend:
    """A shift, mm, and a small turn, rad, of a link's end along and about the axes of the frame at it."""

    joint: int  # that moves the link
    width = 6

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the link's end turned (alpha and beta of the link, theta of the next row) and shifted."""
        base_R_end = state.loaded.chain.base_T_frame[:, self.joint + 1, :3, :3]
        shift_mm = np.einsum("nij,nj->ni", base_R_end, amounts[:, :3])
        return turned_end(state, self.joint, amounts[:, 3:]).displace(shift_mm)


@dataclass(frozen=True)
class HeatOfMotor:
    """A motor's heat at its own joint: an offset of theta, rad, and a growth of the link's a and d."""

    joint: int  # revolute
    width = 2

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the joint's error added and its link longer."""
        nominal = state.robot.table[self.joint]
        state = state.add_joint_error(self.joint, amounts[:, 0])
        for column, kind in ((0, "a"), (2, "d")):
            if nominal[column] != 0.0:
                state = state.add_link_error(self.joint, kind, amounts[:, 1] * nominal[column])
        return state


@dataclass(frozen=True)
class Growth:
    """A growth of all lengths: a and d times 1 + amount."""

    width = 1

    def act(self, state: RobotState, amounts: Array) -> RobotState:
        """Robot state with the lengths scaled."""
        nominal = state.robot.table
        for frame in range(len(nominal)):
            for column, kind in ((0, "a"), (2, "d")):
                if nominal[frame, column] != 0.0:
                    state = state.add_link_error(frame, kind, amounts[:, 0] * nominal[frame, column])
        return state
