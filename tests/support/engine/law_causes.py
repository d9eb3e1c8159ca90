"""Causes that no catalogue has but that follow a short law: of load and angle, of two joints, of the way that was gone.

Each moves one joint. `FORMS` tells what a reader of the result would have to be told to find the part.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell
from tests.support.engine.joint_causes import Rng, carriers, moves
from tests.support.engine.mechanics import Array, Posture
from tests.support.engine.unforeseen_causes import creeping_joint, product_of_joints, root_of_angle

Law = Callable[[Cell, Posture, int], Array]


def _of_one(name: str, law: Law, cell: Cell, rng: Rng, allowed: Array | None = None) -> Cause:
    """The law on one of the joints that show it."""

    def make(shares: Array) -> Cause:
        return moves(name, shares, law)

    return make(carriers(cell, rng, make, cell.turns if allowed is None else allowed, most=1))


def _load(cell: Cell, here: Posture, joint: int) -> Array:
    """Torque about a joint over its largest."""
    load = here.load(joint, False)
    return load / max(float(np.abs(cell.plain.load(joint, False)).max()), 1e-9)


def _loaded(cell: Cell) -> Array:
    """Joints of which the torque varies by more than its hundredth part of the largest of all."""
    spans = np.array([np.ptp(cell.plain.load(j, False)) for j in range(cell.arm.n)])
    return cell.turns & (spans > 0.02 * spans.max())


def _others(cell: Cell, rng: Rng, *, near: bool = True) -> Array:
    """For each joint another turning one, drawn; not a neighbour unless `near`."""
    turning = np.flatnonzero(cell.turns)
    out = np.full(cell.arm.n, -1)
    for j in range(cell.arm.n):
        choice = [k for k in turning if k != j and (near or abs(k - j) > 1)]
        if choice:
            out[j] = rng.choice(choice)
    return out


def _way(angle: Array) -> Array:
    return np.diff(angle, prepend=angle[:1])


def ripple_under_load(cell: Cell, rng: Rng) -> Cause:
    """Teeth or rollers that give way unevenly: a wave of the angle that grows with the load."""
    order, phase = int(rng.integers(4, 31)), rng.uniform(0.0, 2.0 * np.pi)
    return _of_one(
        "ripple_under_load",
        lambda c, here, j: _load(c, here, j) * np.cos(order * c.q[:, j] - phase),
        cell,
        rng,
        _loaded(cell),
    )


def soft_end(cell: Cell, rng: Rng) -> Cause:
    """A drive that gives way the more the further the joint has turned."""
    return _of_one("soft_end", lambda c, here, j: _load(c, here, j) * c.q[:, j], cell, rng, _loaded(cell))


def preloaded_spring(cell: Cell, rng: Rng) -> Cause:
    """A preload that lets go beyond a torque: stiff below, soft above."""
    share = rng.uniform(-0.2, 0.5)

    def law(c: Cell, here: Posture, j: int) -> Array:
        load = _load(c, here, j)
        return np.maximum(load - (load.min() + (0.5 + 0.5 * share) * np.ptp(load)), 0.0)

    return _of_one("preloaded_spring", law, cell, rng, _loaded(cell))


def tendon_load(cell: Cell, rng: Rng) -> Cause:
    """A tendon led past a joint pulls it with the torque of another."""
    loaded = np.flatnonzero(_loaded(cell))
    source = {j: int(rng.choice([k for k in loaded if k != j])) for j in range(cell.arm.n) if len(loaded) > 1}
    return _of_one("tendon_load", lambda c, here, j: _load(c, here, source[j]), cell, rng, cell.turns)


def wave_of_another(cell: Cell, rng: Rng) -> Cause:
    """The transmission of another joint, led through this one, is out of true."""
    other, order, phase = _others(cell, rng), int(rng.integers(2, 8)), rng.uniform(0.0, 2.0 * np.pi)
    return _of_one("wave_of_another", lambda c, here, j: np.cos(order * c.q[:, other[j]] - phase), cell, rng)


def led_along(cell: Cell, rng: Rng) -> Cause:
    """A joint is led along by one that is no neighbour of the wrist."""
    other = _others(cell, rng)
    n = cell.arm.n
    known = np.array([j >= n - 2 and j - other[j] in (1, 2) for j in range(n)])
    return _of_one("led_along", lambda c, here, j: c.q[:, other[j]], cell, rng, cell.turns & ~known)


def long_cable(cell: Cell, rng: Rng) -> Cause:
    """A cable over joints that are no neighbours: a wave of their sum or difference."""
    other, sign = _others(cell, rng, near=False), float(rng.choice([-1.0, 1.0]))
    order, phase = int(rng.integers(1, 4)), rng.uniform(0.0, 2.0 * np.pi)
    return _of_one(
        "long_cable",
        lambda c, here, j: np.cos(order * (c.q[:, j] + sign * c.q[:, other[j]]) - phase),
        cell,
        rng,
        cell.turns & (other >= 0),
    )


def fine_teeth(cell: Cell, rng: Rng) -> Cause:
    """A gear ring of many teeth."""
    order, phase = int(rng.integers(24, 56)), rng.uniform(0.0, 2.0 * np.pi)
    return _of_one("fine_teeth", lambda c, here, j: np.cos(order * c.q[:, j] - phase), cell, rng)


def bent_scale(cell: Cell, rng: Rng) -> Cause:
    """An encoder tape glued in two pieces: another scale beyond a place."""
    share = rng.uniform(0.3, 0.7)

    def law(c: Cell, here: Posture, j: int) -> Array:
        angle = c.q[:, j]
        return np.maximum(angle - np.quantile(angle, share), 0.0)

    return _of_one("bent_scale", law, cell, rng)


def side_by_place(cell: Cell, rng: Rng) -> Cause:
    """Play that changes along the ring: the side of the last motion times a wave of the angle."""
    order, phase = int(rng.integers(1, 9)), rng.uniform(0.0, 2.0 * np.pi)
    return _of_one("side_by_place", lambda c, here, j: c.approach[:, j] * np.cos(order * c.q[:, j] - phase), cell, rng)


def side_by_load(cell: Cell, rng: Rng) -> Cause:
    """Friction in proportion to the load holds the joint back from either side."""
    return _of_one("side_by_load", lambda c, here, j: c.approach[:, j] * _load(c, here, j), cell, rng, _loaded(cell))


def dragged_on(cell: Cell, rng: Rng) -> Cause:
    """A hose that lies as another joint left it pulls this one after the other's motion."""
    other = _others(cell, rng)
    return _of_one("dragged_on", lambda c, here, j: _way(c.q[:, other[j]]), cell, rng)


def rubber_hose(cell: Cell, rng: Rng) -> Cause:
    """A joint is pulled back to where it was in the last minutes."""
    settling = rng.uniform(90.0, 400.0)

    def law(c: Cell, here: Posture, j: int) -> Array:
        state, out = c.q[0, j], np.zeros(c.poses)
        for k in range(1, c.poses):
            state += (c.q[k - 1, j] - state) * (1.0 - np.exp(-(c.time_s[k] - c.time_s[k - 1]) / settling))
            out[k] = c.q[k, j] - state
        return out

    return _of_one("rubber_hose", law, cell, rng)


def worn_on_the_way(cell: Cell, rng: Rng) -> Cause:
    """A clamp works loose with every degree that the joint goes."""
    return _of_one("worn_on_the_way", lambda c, here, j: np.cumsum(np.abs(_way(c.q[:, j]))), cell, rng)


LAW_CAUSES = {
    draw.__name__: draw
    for draw in (
        *(ripple_under_load, soft_end, preloaded_spring, tendon_load, wave_of_another, led_along, long_cable),
        *(fine_teeth, bent_scale, side_by_place, side_by_load, dragged_on, rubber_hose, worn_on_the_way),
        *(root_of_angle, product_of_joints, creeping_joint),
    )
}
FORMS = {
    "ripple_under_load": "load by angle",
    "soft_end": "load by angle",
    "preloaded_spring": "load",
    "tendon_load": "load of another joint",
    "wave_of_another": "wave of another joint",
    "led_along": "coupling",
    "long_cable": "wave of two joints",
    "fine_teeth": "own angle",
    "bent_scale": "own angle",
    "side_by_place": "direction by angle",
    "side_by_load": "direction by load",
    "dragged_on": "way from the pose before",
    "rubber_hose": "slow recovery",
    "worn_on_the_way": "distance travelled",
    "root_of_angle": "own angle",
    "product_of_joints": "product of joints",
    "creeping_joint": "slow recovery",
}
"""The form of each cause's law, in the words of the tool."""
