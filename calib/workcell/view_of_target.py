"""A target fixed in the room, seen by a scanner on the flange: its place, the cone it was seen from, view goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.frames import apply, invert
from calib.kinematics.chain import Chain, joint_jacobian, nominal_chain
from calib.kinematics.robot import Robot

_LEVER_MM = 300.0  # weighs one radian of the line of sight against millimetres
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


@dataclass(frozen=True)
class ViewGoals:
    """N goals of an arm with a flange scanner: a point and a direction of the flange at given ones of the base frame.

    They are a target's place and axis, as desired in the scanner's view and as they are in the room; the scanner's
    rotation about the axis is free.
    """

    robot: Robot
    point_mm: Array  # (N, 3) flange frame
    direction: Array  # (N, 3) unit, flange frame
    apex_mm: Array  # (3,) base frame
    axis: Array  # (3,) unit, base frame
    prismatic_unit_mm: float = 1.0  # that counts as much as a radian

    @property
    def joint_units(self) -> Array:
        """(n,) unit of each joint: 1 rad, or the equivalent length in mm."""
        return np.where(self.robot.is_revolute, 1.0, self.prismatic_unit_mm)

    def _point_and_direction(self, chain: Chain, rows: IndexArray | slice) -> tuple[Array, Array]:
        """Point (K, 3) mm and direction (K, 3) at each pose, base frame."""
        flange = chain.base_T_flange
        point_mm = np.einsum("kij,kj->ki", flange[:, :3, :3], self.point_mm[rows]) + flange[:, :3, 3]
        return point_mm, np.einsum("kij,kj->ki", flange[:, :3, :3], self.direction[rows])

    def linearise(self, q: Array, rows: IndexArray) -> tuple[Array, Array]:
        """Error of the point, and the sine of the direction's error times `_LEVER_MM`, with their Jacobian."""
        chain = nominal_chain(self.robot, q)
        moved, axes = joint_jacobian(chain, self.robot.is_revolute)
        point_mm, direction = self._point_and_direction(chain, rows)
        moved = moved + np.swapaxes(np.cross(np.swapaxes(axes, 1, 2), (point_mm - chain.target_mm)[:, None]), 1, 2)
        turn = np.cross(direction, self.axis)
        turn += np.where(direction @ self.axis < -0.99, 0.1, 0.0)[:, None]  # the wrong way round: any turn leads on
        axes = axes - direction[:, :, None] * np.einsum("ki,kin->kn", direction, axes)[:, None]
        error = np.concatenate([self.apex_mm - point_mm, _LEVER_MM * turn], axis=1)
        return error, np.concatenate([moved, _LEVER_MM * axes], axis=1) * self.joint_units

    def reached(self, chain: Chain) -> BoolArray:
        """Mask (N,): whether point and direction are at their goals, to 1 mm and 0.02 rad."""
        point_mm, direction = self._point_and_direction(chain, slice(None))
        near = np.linalg.norm(point_mm - self.apex_mm, axis=1) < 1.0
        return near & (np.arccos(np.clip(direction @ self.axis, -1.0, 1.0)) < 0.02)


def in_view_mm(base_T_scanner: Array, place_mm: Array) -> Array:
    """Place of a target (3,), base frame, in the frames (N, 4, 4) of a moving scanner: (N, 3)."""
    return np.array([apply(invert(one), place_mm[None])[0] for one in base_T_scanner]).reshape(-1, 3)
