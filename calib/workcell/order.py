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
    """(N, M) largest joint movement, rad, between joints (N, n) and (M, n)."""
    scaled = np.where(robot.is_revolute, 1.0, 1.0 / PRISMATIC_MM)
    return np.asarray(np.abs((one[:, None] - other[None]) * scaled).max(axis=-1))


def path_length(robot: Robot, q: Array) -> float:
    """Sum of the largest joint movements, rad, from row to row of q (N, n)."""
    scaled = np.where(robot.is_revolute, 1.0, 1.0 / PRISMATIC_MM)
    return float(np.abs(np.diff(q, axis=0) * scaled).max(axis=1).sum())


def clear_ways(cell: Workcell, q: Array) -> BoolArray:
    """(N - 1,) whether straight paths in joint space between the rows of q (N, n) avoid all known obstacles."""
    if len(q) < 2:
        return np.ones(0, dtype=bool)
    longest = max(way_lengths(cell.robot, q[k : k + 1], q[k + 1 : k + 2])[0, 0] for k in range(len(q) - 1))
    steps = int(np.clip(np.ceil(longest / _STEP), 1, _MOST_STEPS))
    share = (np.arange(steps) + 0.5) / steps
    between = q[:-1, None] + share[None, :, None] * np.diff(q, axis=0)[:, None]
    hits = collides(cell, between.reshape(-1, q.shape[1])).reshape(len(q) - 1, steps)
    return np.asarray(~hits.any(axis=1))


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
