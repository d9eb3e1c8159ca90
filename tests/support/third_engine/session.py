"""A measuring session: an arm as built, its poses and their conditions, an instrument, and what geometry absorbs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.support.third_engine.arms import Make, erring
from tests.support.third_engine.screws import (
    Array,
    Build,
    Flex,
    Load,
    Motion,
    Stance,
    product,
    quaternion,
    rotated,
    rotation_vector,
    stand,
)


@dataclass(frozen=True, eq=False)
class Cause:
    """A hidden cause, whose displacement grows with its size, and the names that are true of it."""

    law: str
    names: tuple[str, ...] = ()  # effects that are true of it, the law's own first
    flex: Callable[[Session, Stance, float], Flex] | None = None  # by the stance under load
    report: Callable[[Session, Stance, Array, float], Array] | None = None  # (N, 3) mm added to points that are seen
    load: Callable[[Session, float], Load] | None = None  # a mass that the sheet does not know
    known: Callable[[float], dict[str, float]] | None = None  # parameters by calib's names, at a size
    outside: bool = False  # none of them is the law itself: nobody can be asked to tell it, but to claim one is right
    every: bool = False  # it is told by all its names together only
    noise: bool = False  # it may also be told as a shape of the noise


Hidden = Sequence[tuple[Cause, float]]


@dataclass(frozen=True, eq=False)
class Session:
    """N poses of an arm before an instrument. All that is in it is true, whatever the sheet says."""

    make: Make
    build: Build
    q: Array  # (N, n) commanded
    payload_kg: Array  # (N,)
    temperature_c: Array  # (N,)
    time_s: Array  # (N,)
    approach: Array  # (N, n) -1 or 1
    setup: NDArray[np.int64]  # (N,)
    view: tuple[Motion, ...]  # base to instrument, of each setup, one pose long
    mass_factor: float = 1.0  # true masses over those of the sheet
    target_of_setup: Array | None = None  # (S, 3) mm: the target stood elsewhere on the tool

    @property
    def count(self) -> int:
        return len(self.q)

    @cached_property
    def gravity(self) -> Array:
        return np.array(self.make.gravity)

    @cached_property
    def loads(self) -> list[Load]:
        """Masses of links, tool and payload."""
        make, last = self.make, self.make.n - 1
        ones = np.ones(self.count)
        out = [
            Load(j, self.mass_factor * kg * ones, make.place(j, com))
            for j, (kg, com) in enumerate(zip(make.mass_kg, make.com_mm, strict=True))
        ]
        out.append(Load(last, make.tool_kg * ones, make.place(last, make.tool_com_mm)))
        out.append(Load(last, self.payload_kg, make.place(last, make.payload_com_mm)))
        return out

    @cached_property
    def still(self) -> Flex:
        return Flex.none(self.count, self.make.n)

    @cached_property
    def plain(self) -> Stance:
        """The arm without any hidden cause."""
        return stand(self.build, self.q, self.still, self.loads, self.gravity)

    @cached_property
    def travel(self) -> Array:
        """(N, n) way of each joint from the pose before; the first pose is come to from the last."""
        return np.diff(self.q, axis=0, prepend=self.q[-1:])

    @cached_property
    def units(self) -> Array:
        """(n,) a small motion of each joint: 0.1 mrad, or 0.05 mm where it slides."""
        return np.where(self.make.slides, 0.05, 1e-4)

    @cached_property
    def span(self) -> Array:
        """(n,) half of each joint's range over the poses, at least 0.2."""
        return np.maximum(0.5 * np.ptp(self.q, axis=0), 0.2)

    @cached_property
    def part(self) -> Array:
        """(N,) 0 at the first pose to 1 at the last, in time."""
        return self.time_s / self.time_s[-1]

    def stance(self, hidden: Hidden) -> Stance:
        """The arm in equilibrium with all its hidden causes."""
        extra = [cause.load(self, size) for cause, size in hidden if cause.load is not None]
        bending = [(cause.flex, size) for cause, size in hidden if cause.flex is not None]
        loads = [*self.loads, *extra]
        here = stand(self.build, self.q, self.still, loads, self.gravity) if extra else self.plain
        for _ in range(4 if bending else 0):
            total = self.still
            for flex, size in bending:
                total = total + flex(self, here, size)
            here = stand(self.build, self.q, total, loads, self.gravity)
        return here

    def seen(self, points: Array) -> Array:
        """Points (N, 3) of the base in the frame of each pose's instrument."""
        turn = np.concatenate([view.turn for view in self.view])[self.setup]
        shift = np.concatenate([view.shift for view in self.view])[self.setup]
        return rotated(turn, points) + shift

    def reported(self, hidden: Hidden) -> Array:
        """Points (N, 3) as the instrument reports them, without noise."""
        here = self.stance(hidden)
        tip = here.tip
        if self.target_of_setup is not None:
            tip = tip + here.body[-1].pointing(self.target_of_setup[self.setup])
        exact = self.seen(tip)
        return exact + sum(
            (cause.report(self, here, exact, size) for cause, size in hidden if cause.report is not None),
            np.zeros_like(exact),
        )

    @cached_property
    def geometry(self) -> Array:
        """(3 N, K) orthonormal, instrument frame: what constant twists of links and setups do to the points."""
        tip, columns = self.plain.tip, []
        turn = np.concatenate([view.turn for view in self.view])[self.setup]
        bodies = [Motion.none(self.count), *self.plain.body]
        masks = [self.setup == s for s in range(len(self.view))]
        for k, body in enumerate(bodies):
            for axis in np.eye(3):
                way = body.pointing(axis)
                for column in (way, np.cross(way, tip - body.shift) / self.make.reach_mm):
                    seen = rotated(turn, column)
                    columns += [(mask[:, None] * seen).ravel() for mask in (masks if k == 0 else [masks[0] | True])]
        left, size, _ = np.linalg.svd(np.column_stack(columns), full_matrices=False)
        return left[:, size > 1e-6 * size[0]]

    def left_mm(self, shift: Array) -> float:
        """Root mean square per coordinate of displacements (N, 3) that no geometry imitates."""
        flat = shift.ravel()
        return float(np.sqrt(np.mean((flat - self.geometry @ (self.geometry.T @ flat)) ** 2)))

    def visible_mm(self, cause: Cause, size: float, given: Hidden = ()) -> float:
        """What a cause beside others leaves after geometry."""
        return self.left_mm(self.reported([*given, (cause, size)]) - self.reported(given))

    def size_for(self, cause: Cause, visible_mm: float, given: Hidden = ()) -> float:
        """The size at which a cause is visible by so much; nan where there is none."""
        size, before = 1.0, self.reported(given)
        for _ in range(3):
            found = self.left_mm(self.reported([*given, (cause, size)]) - before)
            if not np.isfinite(found) or found < 1e-9:
                return float("nan")
            size *= visible_mm / found
        return size

    def joint_left_mm(self, joint: int, way: Array) -> float:
        """What a joint's own error (N,), rad or mm, leaves after geometry, to first order."""
        axis, place = self.plain.axis[joint], self.plain.place[joint]
        lever = axis if self.make.slides[joint] else np.cross(axis, self.plain.tip - place)
        turn = np.concatenate([view.turn for view in self.view])[self.setup]
        return self.left_mm(rotated(turn, way[:, None] * lever))


def draw_session(
    make: Make,
    rng: np.random.Generator,
    *,
    count: int,
    setups: int = 1,
    payload: bool = True,
    tour: bool = False,
    chosen_sides: bool = False,
    one_attitude: bool = False,
    narrow: float = 1.0,
) -> Session | None:
    """A session of drawn poses; None where the arm cannot reach as many.

    tour: each pose is the nearest one left. chosen_sides: each joint comes from a side that was drawn, else from the
    pose before. one_attitude: points of a grid, the tool always turned alike. narrow: share of the joints' ranges used.
    """
    limits = np.array(make.limits) * np.where(make.slides, 1.0, np.pi / 180.0)[:, None]
    middle, half = limits.mean(axis=1), 0.5 * np.ptp(limits, axis=1) * narrow
    low, high = middle - half, middle + half
    q = _grid(make, rng, count, low, high) if one_attitude else _scattered(make, rng, count, low, high)
    if q is None:
        return None
    if tour:
        q = _toured(q, high - low)
    time_s = np.round(np.cumsum(np.append(0.0, rng.uniform(15.0, 60.0, count - 1))), 1)
    side = np.where(np.diff(q, axis=0, prepend=q[-1:]) >= 0.0, 1.0, -1.0)
    tip = stand(make.build(), q, Flex.none(count, make.n)).tip
    hall = sum(rng.uniform(0.5, 2.5) * np.sin(time_s * 6.28 / rng.uniform(1200.0, 6000.0) + k) for k in range(3))
    carried = rng.choice([0.0, 0.3, 0.7], count) * make.payload_kg if payload else np.zeros(count)
    return Session(
        make=make,
        build=erring(make.build(), rng, 0.35, 1.2e-3),
        q=q,
        payload_kg=carried,
        temperature_c=np.round(21.0 + rng.uniform(0.0, 5.0) * time_s / time_s[-1] + hall, 2),
        time_s=time_s,
        approach=rng.choice([-1.0, 1.0], q.shape) if chosen_sides else side,
        setup=np.arange(count) * setups // count,
        view=tuple(_view(tip, make.reach_mm, rng) for _ in range(setups)),
    )


def _scattered(make: Make, rng: np.random.Generator, count: int, low: Array, high: Array) -> Array:
    """Joints drawn evenly, of which those two thirds stay whose points are nearest to the instrument's side."""
    q = _as_written(rng.uniform(low, high, (2 * count, make.n)), make)
    tip = stand(make.build(), q, Flex.none(len(q), make.n)).tip
    towards = np.append(rng.standard_normal(2), 0.3 * rng.standard_normal())
    order = np.argsort(-(tip - tip.mean(axis=0)) @ towards / np.linalg.norm(towards))
    return q[rng.permutation(order[: 4 * count // 3])[:count]]


def _as_written(q: Array, make: Make) -> Array:
    """Joints to a thousandth of a degree or of a millimetre, as a sheet has them."""
    return np.where(make.slides, np.round(q, 3), np.radians(np.round(np.degrees(q), 3)))


def _grid(make: Make, rng: np.random.Generator, count: int, low: Array, high: Array) -> Array | None:
    """Joints of a grid of points about a drawn pose, the tool turned as there: damped Newton steps from neighbours."""
    build, middle = make.build(), 0.5 * (low + high)
    start = middle + 0.35 * rng.uniform(-1.0, 1.0, make.n) * (high - low)
    home = stand(build, start[None], Flex.none(1, make.n))
    attitude = home.body[-1].turn[0]
    steps = np.linspace(-1.0, 1.0, 7)
    cube = 0.3 * make.reach_mm * np.array(np.meshgrid(steps, steps, steps)).reshape(3, -1).T
    aim = home.tip[0] + cube
    q = np.tile(start, (len(aim), 1))
    weight = make.reach_mm
    for part in np.append(np.linspace(0.1, 1.0, 12), np.ones(15)):
        here = stand(build, q, Flex.none(len(q), make.n))
        off = home.tip[0] + part * cube - here.tip
        turned = product(np.tile(attitude, (len(q), 1)), here.body[-1].turn * np.array([1.0, -1.0, -1.0, -1.0]))
        error = np.hstack([off / weight, rotation_vector(turned)])
        jacobian = np.empty((len(q), 6, make.n))
        for j in range(make.n):
            lever = here.axis[j] if make.slides[j] else np.cross(here.axis[j], here.tip - here.place[j])
            jacobian[:, :3, j] = lever / weight
            jacobian[:, 3:, j] = 0.0 if make.slides[j] else here.axis[j]
        normal = np.einsum("nij,nik->njk", jacobian, jacobian) + 1e-5 * np.eye(make.n)
        q = q + np.linalg.solve(normal, np.einsum("nij,ni->nj", jacobian, error)[..., None])[..., 0]
    good = (np.abs(error).max(axis=1) < 1e-5) & np.all((q > low) & (q < high), axis=1)
    if good.sum() < count:
        return None
    return _as_written(q[rng.permutation(np.flatnonzero(good))[:count]], make)


def _toured(q: Array, width: Array) -> Array:
    left, order = list(range(1, len(q))), [0]
    while left:
        way = np.linalg.norm((q[left] - q[order[-1]]) / width, axis=1)
        order.append(left.pop(int(np.argmin(way))))
    return q[order]


def _view(tip: Array, reach_mm: float, rng: np.random.Generator) -> Motion:
    """Base to instrument: its z looks at the middle of the points from 1.2 to 2 reaches away."""
    away = np.append(rng.standard_normal(2), 0.4 * rng.standard_normal())
    place = tip.mean(axis=0) + rng.uniform(1.2, 2.0) * reach_mm * away / np.linalg.norm(away)
    look = tip.mean(axis=0) - place
    look = look / np.linalg.norm(look)
    z = np.array([0.0, 0.0, 1.0])
    turn_axis = np.cross(look, z)
    turn_axis = turn_axis / np.linalg.norm(turn_axis)
    to_z = quaternion(np.arccos(np.clip(look @ z, -1.0, 1.0)) * turn_axis[None])
    roll = quaternion(np.array([[0.0, 0.0, rng.uniform(-3.0, 3.0)]]))
    turn = product(roll, to_z)
    return Motion(turn, -rotated(turn, place[None]))
