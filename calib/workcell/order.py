"""Order of poses with short paths between them that avoid known obstacles where possible."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.array_types import Array, BoolArray, IndexArray
from calib.kinematics.robot import Robot
from calib.workcell.measurable import collides
from calib.workcell.workcell import Workcell

PRISMATIC_MM = 300.0  # of a prismatic joint take as long as a radian of a revolute one
_STEP = 0.15  # rad between the checked places of a path
_MOST_STEPS = 24
_BLOCKED = 20.0  # rad added to the length of a path that leads through an obstacle
_ROUNDS = 8
_TRIED_PATHS = 6
_NEAR_VIAS, _FAR_VIAS = 150, 100  # via points tried between the two ends, and in the joints' whole range
_ROOM_RAD = 0.8  # by which the near ones may lie beyond the ends
_TRIED_PAIRS, _PAIRS_AT_ONCE = 1000, 100


def order_poses(cell: Workcell, q: ArrayLike, start: ArrayLike | None = None) -> IndexArray:
    """Order (N,) in which to visit joints (N, n): nearest neighbour first, then improved by exchanges (2-opt).

    Joints move together, so a path takes as long as the joint that moves most. Paths that lead through the floor, a
    box, the scanner or the arm itself are avoided where that is possible; check the result with `clear_ways`.

    Args:
        start: (n,) joints at which the arm is; None: it begins at any of the poses.
    """
    q = np.atleast_2d(np.asarray(q, dtype=float))
    if not len(q):
        return np.zeros(0, dtype=np.intp)
    given = start is not None
    nodes = np.concatenate([np.atleast_2d(np.asarray(start, dtype=float)), q]) if given else q
    apart = way_lengths(cell.robot, nodes, nodes)
    best, fewest = np.arange(len(nodes)), len(nodes)
    for _ in range(_ROUNDS):
        order = _short_path(apart, from_first=given)
        blocked = np.flatnonzero(~clear_ways(cell, nodes[order]))
        if len(blocked) < fewest:
            best, fewest = order, len(blocked)
        if not len(blocked):
            break
        one, other = order[blocked], order[blocked + 1]
        apart[one, other] += _BLOCKED
        apart[other, one] += _BLOCKED
    return best[1:] - 1 if given else best


def way_lengths(robot: Robot, one: Array, other: Array) -> Array:
    """Largest joint movement (N, M), rad, between joints (N, n) and (M, n)."""
    scaled = np.where(robot.is_revolute, 1.0, 1.0 / PRISMATIC_MM)
    return np.asarray(np.abs((one[:, None] - other[None]) * scaled).max(axis=-1))


def clear_ways(cell: Workcell, q: Array) -> BoolArray:
    """Mask (N - 1,): whether straight paths in joint space between the rows of q (N, n) avoid all known obstacles."""
    return clear_between(cell, q[:-1], q[1:])


def clear_between(cell: Workcell, one: Array, other: Array) -> BoolArray:
    """Mask (N,): straight paths in joint space from the rows of one (N, n) to those of other avoid all obstacles."""
    if not len(one):
        return np.ones(0, dtype=bool)
    scaled = np.where(cell.robot.is_revolute, 1.0, 1.0 / PRISMATIC_MM)
    steps = int(np.clip(np.ceil(np.abs((other - one) * scaled).max() / _STEP), 1, _MOST_STEPS))
    share = (np.arange(steps) + 0.5) / steps
    between = one[:, None] + share[None, :, None] * (other - one)[:, None]
    hits = collides(cell, between.reshape(-1, one.shape[1])).reshape(len(one), steps)
    return np.asarray(~hits.any(axis=1))


def way_around(cell: Workcell, one: Array, other: Array, rng: np.random.Generator) -> Array | None:
    """Via points (k, n), k 1 or 2, by which straight paths lead from joints one (n,) to other past all obstacles.

    The shortest way by one of some hundred random joint vectors; where there is none, by two of them.

    Returns:
        None where these find no way: there may be one all the same.
    """
    robot = cell.robot
    room = np.where(robot.is_revolute, _ROOM_RAD, _ROOM_RAD * PRISMATIC_MM)
    near = rng.uniform(np.minimum(one, other) - room, np.maximum(one, other) + room, (_NEAR_VIAS, len(one)))
    drawn = np.concatenate([near, rng.uniform(cell.low, cell.high, (_FAR_VIAS, len(one)))])
    drawn = np.clip(drawn, np.minimum(cell.low, one), np.maximum(cell.high, one))
    drawn = drawn[~collides(cell, drawn)]
    from_one = drawn[clear_between(cell, np.broadcast_to(one, drawn.shape), drawn)]
    to_other = drawn[clear_between(cell, drawn, np.broadcast_to(other, drawn.shape))]
    both = from_one[(from_one[:, None] == to_other[None]).all(axis=2).any(axis=1)] if len(to_other) else to_other
    if len(both):
        length = way_lengths(robot, both, one[None])[:, 0] + way_lengths(robot, both, other[None])[:, 0]
        return np.asarray(both[[int(np.argmin(length))]])
    if not len(from_one) or not len(to_other):
        return None
    length = way_lengths(robot, from_one, to_other)
    length += way_lengths(robot, from_one, one[None]) + way_lengths(robot, to_other, other[None]).T
    first, second = np.unravel_index(np.argsort(length, axis=None, kind="stable")[:_TRIED_PAIRS], length.shape)
    for some in np.array_split(np.arange(len(first)), max(1, len(first) // _PAIRS_AT_ONCE)):
        clear = clear_between(cell, from_one[first[some]], to_other[second[some]])
        if clear.any():
            k = some[int(np.argmax(clear))]
            return np.stack([from_one[first[k]], to_other[second[k]]])
    return None


def _short_path(apart: Array, *, from_first: bool) -> IndexArray:
    """Short open path through all nodes of a matrix of distances (N, N), from the first node where `from_first`."""
    starts = [0] if from_first else range(len(apart))
    paths = [_nearest_neighbours(apart, first) for first in starts]
    shorter = [_exchanged(apart, path, from_first=from_first) for path in _shortest(apart, paths)]
    return _shortest(apart, shorter)[0]


def _shortest(apart: Array, paths: list[IndexArray]) -> list[IndexArray]:
    """The few shortest of some paths, in ascending order of length."""
    lengths = [apart[path[:-1], path[1:]].sum() for path in paths]
    return [paths[k] for k in np.argsort(lengths, kind="stable")[:_TRIED_PATHS]]


def _nearest_neighbours(apart: Array, first: int) -> IndexArray:
    """Path that starts at the node `first` and goes to the nearest unvisited node each time."""
    remaining = apart.copy()
    path = [first]
    for _ in range(len(apart) - 1):
        remaining[:, path[-1]] = np.inf
        path.append(int(np.argmin(remaining[path[-1]])))
    return np.array(path)


def _exchanged(apart: Array, path: IndexArray, *, from_first: bool) -> IndexArray:
    """Path shortened by reversing pieces of it, also at its end, until no reversal makes it shorter."""
    n = len(path)
    padded = np.pad(apart, ((0, 1), (0, 1)))  # a node beyond either end, at no distance
    for _ in range(50 * n):
        tour = np.concatenate([[n], path, [n]])
        before, first, last, after = tour[:-2], tour[1:-1], tour[1:-1], tour[2:]
        now = padded[before, first][:, None] + padded[last, after][None, :]
        then = padded[before[:, None], last[None, :]] + padded[first[:, None], after[None, :]]
        gain = np.triu(now - then, 1)
        if from_first:
            gain[0] = 0.0
        i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[i, j] <= 1e-12:
            break
        path = np.concatenate([path[:i], path[i : j + 1][::-1], path[j + 1 :]])
    return path
