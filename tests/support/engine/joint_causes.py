"""Causes that move a joint by its own angle, another's, or the side it came from; and axes that wobble."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell
from tests.support.engine.mechanics import Array, Deformation, Posture

Rng = np.random.Generator
Law = Callable[[Cell, int], Array]


def unit(cell: Cell, joint: int) -> float:
    """A small motion of a joint: 0.1 mrad, or 0.05 mm where it slides."""
    return 0.05 if cell.arm.slides[joint] else 1e-4


def moves(name: str, shares: Array, law: Callable[[Cell, Posture, int], Array]) -> Cause:
    """Joint j moves by size * shares[j] * law(cell, posture, j) (N,) of its small motions."""

    def deform(cell: Cell, here: Posture, size: float) -> Deformation:
        out = np.zeros_like(cell.q)
        for j in np.flatnonzero(shares):
            out[:, j] = size * shares[j] * unit(cell, int(j)) * law(cell, here, int(j))
        return replace(cell.stiff, joint=out)

    return Cause(name, deform)


def carriers(
    cell: Cell,
    rng: Rng,
    make: Callable[[Array], Cause],
    allowed: Array,
    *,
    most: int | None = None,
    signed: bool = True,
) -> Array:
    """(n,) shares of joints that carry a cause: one to three of those that show it, or all. `most`: at the most."""
    n = cell.arm.n
    seen = np.zeros(n)
    for j in np.flatnonzero(allowed):
        seen[j] = cell.visible_mm([(make(np.eye(n)[j]), 1.0)])
    showing = np.flatnonzero(seen > 0.1 * seen.max())
    if not seen.max() > 1e-6:
        return np.zeros(n)
    many = len(showing) if most is None and rng.random() < 0.4 else min(most or 3, len(showing))
    chosen = rng.permutation(showing)[: many if most is None and many > 3 else int(rng.integers(1, many + 1))]
    share = np.zeros(n)
    share[chosen] = rng.uniform(0.5, 1.5, len(chosen))
    return share * rng.choice([-1.0, 1.0], n) if signed else share


def _by_angle(name: str, law: Callable[[Array], Array]) -> Callable[[Cell, Rng], Cause]:
    """Each of some joints moves by the same law of its own angle, either sign."""

    def draw(cell: Cell, rng: Rng) -> Cause:
        def make(shares: Array) -> Cause:
            return moves(name, shares, lambda c, here, j: law(c.q[:, j] / (300.0 if c.arm.slides[j] else 1.0)))

        return make(carriers(cell, rng, make, np.ones(cell.arm.n)))

    return draw


def transmission_error(cell: Cell, rng: Rng, joint: int | None = None) -> Cause:
    """Each joint at one of n = 1, 2, 3; a certain joint at n = 1."""
    order, phase = rng.integers(1, 4, cell.arm.n), rng.uniform(0, 2 * np.pi, cell.arm.n)

    def make(shares: Array) -> Cause:
        return moves("transmission_error", shares, lambda c, here, j: np.cos(order[j] * c.q[:, j] - phase[j]))

    if joint is not None:
        order[joint] = 1
        return make(np.eye(cell.arm.n)[joint])
    return make(carriers(cell, rng, make, cell.turns))


def strain_wave(cell: Cell, rng: Rng) -> Cause:
    """Once or twice in a turn of the motor."""
    order = cell.arm.gear * rng.integers(1, 3, cell.arm.n)
    phase = rng.uniform(0, 2 * np.pi, cell.arm.n)

    def make(shares: Array) -> Cause:
        return moves("strain_wave", shares, lambda c, here, j: np.cos(order[j] * c.q[:, j] - phase[j]))

    return make(carriers(cell, rng, make, cell.turns))


def joint_coupling(cell: Cell, rng: Rng) -> Cause:
    """A following joint: one of the last two follows the one before it, or the last one the one before that."""
    n = cell.arm.n
    pairs = [(j, k) for j, k in ((n - 1, n - 2), (n - 2, n - 3), (n - 1, n - 3)) if cell.turns[[j, k]].all()]

    def make(joint: int, driver: int) -> Cause:
        return moves("joint_coupling", np.eye(n)[joint], lambda c, here, j: c.q[:, driver])

    seen = [cell.visible_mm([(make(*pair), 1.0)]) for pair in pairs]
    if not seen or not max(seen) > 1e-6:
        return moves("joint_coupling", np.zeros(n), lambda c, here, j: c.q[:, j])
    shown = [pair for pair, mm in zip(pairs, seen, strict=True) if mm > 0.1 * max(seen)]
    return make(*shown[rng.integers(len(shown))])


def backlash(cell: Cell, rng: Rng) -> Cause:
    """Half the play to the side that the joint came from."""

    def make(shares: Array) -> Cause:
        return moves("backlash", shares, lambda c, here, j: c.approach[:, j])

    return make(carriers(cell, rng, make, np.ones(cell.arm.n), signed=False))


def axis_wobble(cell: Cell, rng: Rng, joint: int | None = None, order: int | None = None) -> Cause:
    """An axis leans about its origin, an ellipse once or twice a turn; that of a certain joint in a circle.

    A circle twice a turn is, beside geometry, what an error once a turn of that joint's angle does to points beyond it.
    """
    n = cell.arm.n
    order = int(rng.integers(1, 3)) if order is None else order
    wave = rng.standard_normal((n, 2)) + 1j * rng.standard_normal((n, 2))

    def make(shares: Array) -> Cause:
        def deform(c: Cell, here: Posture, size: float) -> Deformation:
            tilt = np.zeros((c.poses, n, 3))
            for j in np.flatnonzero(shares):
                circle = np.exp(1j * order * c.q[:, j])
                for axis in (0, 1):
                    tilt[:, j, axis] = size * 1e-4 * abs(shares[j]) * (wave[j, axis] * circle).real
            return replace(c.stiff, tilt=tilt)

        return Cause("axis_wobble", deform)

    if joint is not None:
        wave[joint, 1] = -1j * wave[joint, 0]
        return make(np.eye(n)[joint])
    return make(carriers(cell, rng, make, cell.turns))


def asymmetric_scale(cell: Cell, rng: Rng) -> Cause:
    """|q| of joints whose poses lie on both sides of zero."""
    both = [min((cell.q[:, j] > 0).mean(), (cell.q[:, j] < 0).mean()) > 0.15 for j in range(cell.arm.n)]

    def make(shares: Array) -> Cause:
        return moves("asymmetric_scale", shares, lambda c, here, j: np.abs(c.q[:, j]))

    return make(carriers(cell, rng, make, np.array(both) & cell.turns, most=1))


def high_harmonic(cell: Cell, rng: Rng) -> Cause:
    """A ripple of one joint, 4 to 20 times a turn."""
    order, phase = int(rng.integers(4, 21)), rng.uniform(0, 2 * np.pi)

    def make(shares: Array) -> Cause:
        return moves("high_harmonic", shares, lambda c, here, j: np.cos(order * c.q[:, j] - phase))

    return make(carriers(cell, rng, make, cell.turns, most=1))


def cable_drag(cell: Cell, rng: Rng) -> Cause:
    """A hose over two joints pulls by the sum, or the difference, of their angles."""
    sign, phase = rng.choice([-1.0, 1.0]), rng.uniform(0, 2 * np.pi)
    order = int(rng.integers(1, 3))
    pair = np.append(cell.turns[:-1] & cell.turns[1:], False)

    def make(shares: Array) -> Cause:
        return moves(
            "cable_drag",
            shares,
            lambda c, here, j: np.cos(order * (c.q[:, j] + sign * c.q[:, j + 1]) - phase),
        )

    return make(carriers(cell, rng, make, pair, most=1))


def joint_dent(cell: Cell, rng: Rng) -> Cause:
    """A bump 0.3 to 0.6 rad wide in all, where six poses or more are."""
    half = rng.uniform(0.15, 0.3)
    place = cell.q[rng.integers(cell.poses)]
    inside = np.abs(cell.q - place) < half

    def make(shares: Array) -> Cause:
        def bump(c: Cell, here: Posture, j: int) -> Array:
            u = np.clip((c.q[:, j] - place[j]) / half, -1.0, 1.0)
            return 0.5 * (1.0 + np.cos(np.pi * u))

        return moves("joint_dent", shares, bump)

    return make(carriers(cell, rng, make, cell.turns & (inside.sum(axis=0) >= 6), most=1))


def following_error(cell: Cell, rng: Rng) -> Cause:
    """Read before it settled: a share of the way from the pose before is still to go."""

    def make(shares: Array) -> Cause:
        def late(c: Cell, here: Posture, j: int) -> Array:
            return np.append(0.0, np.diff(c.q[:, j])) / (300.0 if c.arm.slides[j] else 1.0)

        return moves("following_error", shares, late)

    return make(carriers(cell, rng, make, np.ones(cell.arm.n), signed=False))


joint_scale = _by_angle("joint_scale", lambda q: q)
