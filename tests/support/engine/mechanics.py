"""Frames, weights and equilibrium of an arm whose parts give way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Deformation:
    """Displacement of each part from where it was sent, at N poses; turns are rotation vectors in the part's frame."""

    joint: Array  # (N, n) rad or mm
    tilt: Array  # (N, n, 3) of a joint's axis about its origin, in the frame that carries it
    turn: Array  # (N, n, 3) of a link's end, in the link's frame
    shift: Array  # (N, n, 3) mm
    base_turn: Array  # (N, 3)
    base_shift: Array  # (N, 3) mm
    growth: Array  # (N,) share by which lengths grow
    tool: Array  # (N, 3) mm, in the last link's frame
    target: Array  # (N, 3) mm, in the base's axes

    @classmethod
    def none(cls, poses: int, n: int) -> Deformation:
        each, parts = np.zeros((poses, 3)), np.zeros((poses, n, 3))
        return cls(np.zeros((poses, n)), parts, parts, parts, each, each, np.zeros(poses), each, each)

    def __add__(self, other: Deformation) -> Deformation:
        return Deformation(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True, eq=False)
class Posture:
    """An arm at N poses. Frames are (N, 4, 4) in the base."""

    carrier: tuple[Array, ...]  # n: the frame whose z axis joint j turns about or slides along
    end: tuple[Array, ...]  # n: the frame at the end of link j
    root: tuple[Array, ...]  # n: before the link's length, its axes those of the end
    point: Array  # (N, 3) the tool point
    weights: tuple[tuple[int, Array, Array], ...]  # link that carries it, force (N, 3) N, place (N, 3) mm
    bent: Deformation

    def on_tool(self, place_mm: Array) -> Array:
        """(N, 3) a further target (3,) of the last link's frame; it moves as the tool point does."""
        last = self.end[-1]
        held = np.asarray(place_mm) + self.bent.tool
        return np.einsum("nij,nj->ni", last[:, :3, :3], held) + last[:, :3, 3] + self.bent.target

    def moment(self, about: Array, first: int) -> Array:
        """(N, 3) N m about points (N, 3), of all weights that hang on link `first` or beyond."""
        total = np.zeros_like(about)
        for link, force, place in self.weights:
            if link >= first:
                total = total + np.cross((place - about) / 1000.0, force)
        return total

    def load(self, joint: int, slides: bool) -> Array:
        """(N,) torque about a joint's axis, N m, or force along it, N."""
        axis = self.carrier[joint][:, :3, 2]
        if slides:
            push = sum((f for link, f, _ in self.weights if link >= joint), np.zeros_like(axis))
        else:
            push = self.moment(self.carrier[joint][:, :3, 3], joint)
        return np.einsum("ni,ni->n", axis, push)


def turned(vector: Array) -> Array:
    """(N, 3, 3) rotation by rotation vectors (N, 3): Rodrigues' formula."""
    angle = np.sqrt(np.sum(vector**2, axis=1))[:, None, None]
    cross = np.zeros((len(vector), 3, 3))
    x, y, z = vector.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross[:, 1, 0], cross[:, 2, 0], cross[:, 2, 1] = z, -y, x
    safe = np.where(angle > 1e-12, angle, 1.0)
    first = np.where(angle > 1e-12, np.sin(safe) / safe, 1.0)
    second = np.where(angle > 1e-12, (1.0 - np.cos(safe)) / safe**2, 0.5)
    return np.eye(3) + first * cross + second * (cross @ cross)


def about(axis: int, angle: Array) -> Array:
    """(N, 4, 4) turn about a coordinate axis."""
    out = np.tile(np.eye(4), (len(angle), 1, 1))
    i, k = (axis + 1) % 3, (axis + 2) % 3
    out[:, i, i] = out[:, k, k] = np.cos(angle)
    out[:, k, i] = np.sin(angle)
    out[:, i, k] = -out[:, k, i]
    return out


def along(axis: int, length: Array) -> Array:
    """(N, 4, 4) shift along a coordinate axis."""
    out = np.tile(np.eye(4), (len(length), 1, 1))
    out[:, axis, 3] = length
    return out


def moved(frame: Array, turn: Array, shift: Array | None = None) -> Array:
    """A frame shifted and turned in its own axes."""
    step = np.tile(np.eye(4), (len(frame), 1, 1))
    step[:, :3, :3] = turned(turn)
    if shift is not None:
        step[:, :3, 3] = shift
    return frame @ step


def posture(
    rows: Array,
    slides: Sequence[bool],
    q: Array,
    bent: Deformation,
    weights: Sequence[tuple[int, Array, Array]] = (),
) -> Posture:
    """The arm with rows (n + 1, 5) at joints q (N, n), displaced by `bent`.

    weights: link, force (N, 3) N in the base's axes, centre (3,) mm in the link's frame.
    """
    count, n = q.shape
    grown = 1.0 + bent.growth
    here = np.tile(np.eye(4), (count, 1, 1))
    here[:, :3, :3] = turned(bent.base_turn)
    here[:, :3, 3] = bent.base_shift
    carrier, end, root = [], [], []
    for j, (a, alpha, d, theta, beta) in enumerate(rows):
        angle, slide = np.full(count, theta), d * grown
        if j < n:
            here = moved(here, bent.tilt[:, j])
            carrier.append(here)
            if slides[j]:
                slide = slide + q[:, j] + bent.joint[:, j]
            else:
                angle = angle + q[:, j] + bent.joint[:, j]
        else:
            here = here @ _place(bent.tool)
        before = here @ about(2, angle)
        twist = about(0, np.full(count, alpha)) @ about(1, np.full(count, beta))
        here = before @ along(2, slide) @ along(0, a * grown) @ twist
        if j < n:
            root.append(before @ twist)
            here = moved(here, bent.turn[:, j], bent.shift[:, j])
            end.append(here)
    hung = tuple(
        (link, force, end[min(link, n - 1)][:, :3, :3] @ centre + end[min(link, n - 1)][:, :3, 3])
        for link, force, centre in weights
    )
    return Posture(tuple(carrier), tuple(end), tuple(root), here[:, :3, 3] + bent.target, hung, bent)


def _place(shift: Array) -> Array:
    out = np.tile(np.eye(4), (len(shift), 1, 1))
    out[:, :3, 3] = shift
    return out


def at_rest(
    pose: Callable[[Deformation], Posture],
    give: Callable[[Posture], Deformation],
    start: Deformation,
    *,
    rounds: int = 4,
) -> Posture:
    """The posture in which the parts give way by as much as they are loaded in that posture."""
    here = pose(start)
    for _ in range(rounds):
        here = pose(give(here))
    return here
