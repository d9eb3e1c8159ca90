"""Kinematics and statics of a serial arm by a product of exponentials.

Points fixed to a body are written as they lie in the base frame with all joints at zero (the home position). The
motion of a body then takes them to where they are. Turns are unit quaternions, scalar first; weights are wrenches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def product(left: Array, right: Array) -> Array:
    """Product (N, 4) of quaternions."""
    a, u = left[..., :1], left[..., 1:]
    b, v = right[..., :1], right[..., 1:]
    scalar = a * b - np.sum(u * v, axis=-1, keepdims=True)
    return np.concatenate([scalar, a * v + b * u + np.cross(u, v)], axis=-1)


def rotated(turn: Array, vectors: Array) -> Array:
    """Vectors (N, 3) turned by unit quaternions (N, 4)."""
    twice = 2.0 * np.cross(turn[..., 1:], vectors)
    return vectors + turn[..., :1] * twice + np.cross(turn[..., 1:], twice)


def quaternion(vector: Array) -> Array:
    """Unit quaternions (N, 4) of rotation vectors (N, 3), rad."""
    half = 0.5 * np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vector], axis=-1)


def rotation_vector(turn: Array) -> Array:
    """Rotation vectors (N, 3), rad, of unit quaternions (N, 4)."""
    turn = np.where(turn[..., :1] < 0.0, -turn, turn)
    size = np.linalg.norm(turn[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(size, turn[..., :1])
    return np.where(size > 1e-12, angle / np.maximum(size, 1e-12), 2.0) * turn[..., 1:]


@dataclass(frozen=True, eq=False)
class Motion:
    """Rigid motions of N poses: a point x goes to turn x + shift."""

    turn: Array  # (N, 4)
    shift: Array  # (N, 3) mm

    @classmethod
    def none(cls, count: int) -> Motion:
        """The motion that moves nothing."""
        return cls(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3)))

    @classmethod
    def about(cls, vector: Array, through: Array) -> Motion:
        """A turn by rotation vectors (N, 3) about axes through points (N, 3)."""
        turn = quaternion(vector)
        return cls(turn, through - rotated(turn, np.broadcast_to(through, vector.shape)))

    @classmethod
    def along(cls, shift: Array) -> Motion:
        """A translation (N, 3)."""
        return cls(np.tile([1.0, 0.0, 0.0, 0.0], (len(shift), 1)), shift)

    def __matmul__(self, inner: Motion) -> Motion:
        return Motion(product(self.turn, inner.turn), self.of(inner.shift))

    def of(self, points: Array) -> Array:
        """Points (N, 3) after the motion."""
        return self.pointing(points) + self.shift

    def pointing(self, directions: Array) -> Array:
        """Directions (N, 3) after the motion."""
        return rotated(self.turn, np.broadcast_to(directions, self.shift.shape))

    def back(self, directions: Array) -> Array:
        """Directions (N, 3) before the motion."""
        return rotated(self.turn * np.array([1.0, -1.0, -1.0, -1.0]), np.broadcast_to(directions, self.shift.shape))


@dataclass(frozen=True, eq=False)
class Build:
    """Geometry of an arm in its home position, base frame, mm."""

    axis: Array  # (n, 3) direction of each joint
    through: Array  # (n, 3) a point on it
    end: Array  # (n, 3) the end of each link, where the next joint sits
    cross: Array  # (n, 3) direction of each link's common normal (x of its frame)
    slides: tuple[bool, ...]
    zero: Array  # (n,) error of each joint's zero, rad or mm
    tool: Array  # (3,) the target

    @property
    def n(self) -> int:
        return len(self.slides)


@dataclass(frozen=True, eq=False)
class Load:
    """A mass on a body."""

    body: int
    kg: Array  # (N,)
    place: Array  # (3,) mm, home position


@dataclass(frozen=True, eq=False)
class Flex:
    """Displacements of an arm's parts at N poses; vectors of a part are written in its home position."""

    joint: Array  # (N, n) rad or mm
    lean: Array  # (N, n, 3) rad, of a joint's axis
    bend: Array  # (N, n, 3) rad, of a link's end
    give: Array  # (N, n, 3) mm, of a link's end
    foot_turn: Array  # (N, 3) rad
    foot_shift: Array  # (N, 3) mm
    growth: Array  # (N,) share of all lengths
    tool: Array  # (N, 3) mm

    @classmethod
    def none(cls, count: int, n: int) -> Flex:
        """No displacement."""
        each, parts = np.zeros((count, 3)), np.zeros((count, n, 3))
        return cls(np.zeros((count, n)), parts, parts, parts, each, each, np.zeros(count), each)

    def __add__(self, other: Flex) -> Flex:
        return Flex(*(getattr(self, field.name) + getattr(other, field.name) for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Stance:
    """An arm at N poses, base frame."""

    body: tuple[Motion, ...]  # n, of each link
    axis: tuple[Array, ...]  # n of (N, 3)
    place: tuple[Array, ...]  # n of (N, 3) mm, a point on each axis
    tip: Array  # (N, 3) mm
    mass: tuple[tuple[int, Array, Array], ...]  # body, weight (N, 3) N, centre (N, 3) mm
    force: Array  # (n, N, 3) N, of all weights from each link on
    moment: Array  # (n, N, 3) N mm, of the same about the base's origin

    def moment_about(self, points: Array, first: int) -> Array:
        """Moment (N, 3), N m, about points (N, 3) of all weights on body `first` and later ones."""
        if first >= len(self.body):
            return np.zeros_like(points)
        return (self.moment[first] - np.cross(points, self.force[first])) / 1000.0

    def torque(self, joint: int, *, slides: bool = False) -> Array:
        """Gravity's torque about a joint's axis, N m, or its force along it, N: axis and wrench as screws."""
        push = self.force[joint] if slides else self.moment_about(self.place[joint], joint)
        return np.sum(self.axis[joint] * push, axis=1)

    @property
    def potential(self) -> Array:
        """Potential energy (N,) of all weights, J."""
        return -sum((np.sum(weight * at, axis=1) for _, weight, at in self.mass), np.zeros(len(self.tip))) / 1000.0


def stand(build: Build, q: Array, flex: Flex, loads: Sequence[Load] = (), gravity: Array | None = None) -> Stance:
    """The arm at joints q (N, n), displaced by `flex`, with its weights."""
    count, n = q.shape
    grown = (1.0 + flex.growth)[:, None]
    here = Motion.along(flex.foot_shift) @ Motion.about(flex.foot_turn, np.zeros(3))
    body, axis, place = [], [], []
    for j in range(n):
        through = grown * build.through[j]
        here = here @ Motion.about(flex.lean[:, j], through)
        axis.append(here.pointing(build.axis[j]))
        place.append(here.of(through))
        travel = (q[:, j] + build.zero[j] + flex.joint[:, j])[:, None] * build.axis[j]
        here = here @ (Motion.along(travel) if build.slides[j] else Motion.about(travel, through))
        here = here @ Motion.along(flex.give[:, j]) @ Motion.about(flex.bend[:, j], grown * build.end[j])
        body.append(here)
    down = np.zeros(3) if gravity is None else gravity
    mass = tuple((load.body, load.kg[:, None] * down, body[load.body].of(grown * load.place)) for load in loads)
    force, moment = np.zeros((n, count, 3)), np.zeros((n, count, 3))
    for j in reversed(range(n)):
        if j + 1 < n:
            force[j], moment[j] = force[j + 1], moment[j + 1]
        for carrier, weight, at in mass:
            if carrier == j:
                force[j] = force[j] + weight
                moment[j] = moment[j] + np.cross(at, weight)
    return Stance(tuple(body), tuple(axis), tuple(place), here.of(grown * build.tool + flex.tool), mass, force, moment)
