"""Matching of measured points to joint rows in unknown order, by the points that the nominal arm reaches.

The nominal arm's points and the measured ones are two clouds of one shape. Started from every way to lay the principal
axes of one upon those of the other, the frame and the assignment are found in turn (iterated closest points, each
point used once: Kuhn 1955).
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from calib.array_types import Array, IndexArray
from calib.frames import apply, best_fit_transform, make_transform

_STEPS = 20
_MOST = 400  # points; the assignment takes the third power of their number
_FEWEST = 4  # three points are laid upon any others of about the same distances
_ALL_ORDERS = 6  # points up to which every order is tried
NEAR = 0.2  # of the distance to the next point, within which the matched points have to lie on average


def matched_rows(arm_mm: Array, seen_mm: Array) -> IndexArray | None:
    """For each measured point (K, 3), the index (K,) of the arm's point that matches; None where none fits."""
    count = len(seen_mm)
    if not _FEWEST <= count <= _MOST:
        return None
    if count <= _ALL_ORDERS:
        return _best_order(arm_mm, seen_mm)
    from scipy.optimize import linear_sum_assignment  # slow to load, and rarely needed

    best, least = None, np.inf
    for start in _starts(arm_mm, seen_mm):
        frame, source = start, np.zeros(0, dtype=np.int64)
        for _ in range(_STEPS):
            at = apply(frame, arm_mm)
            square = np.sum((seen_mm[:, None] - at[None]) ** 2, axis=-1)
            again = np.asarray(linear_sum_assignment(square)[1], dtype=np.int64)
            if np.array_equal(again, source):
                break
            source = again
            frame = best_fit_transform(arm_mm[source], seen_mm)
        off = np.linalg.norm(apply(frame, arm_mm[source]) - seen_mm, axis=1)
        middle = float(np.median(off))
        if middle < least:
            best, least = source, middle
    return best if least < NEAR * _apart_mm(seen_mm) else None


def _apart_mm(points_mm: Array) -> float:
    """Median distance, mm, of points (K, 3) from their nearest neighbours."""
    apart = np.linalg.norm(points_mm[:, None] - points_mm[None], axis=-1)
    return float(np.median((apart + np.where(np.eye(len(points_mm)), np.inf, 0.0)).min(axis=1)))


def _best_order(arm_mm: Array, seen_mm: Array) -> IndexArray | None:
    """Best matching order (K,) of the rows over all start transforms; None where none fits."""
    best, least = None, np.inf
    for order in permutations(range(len(seen_mm))):
        mine = arm_mm[list(order)]
        off = float(np.max(np.linalg.norm(apply(best_fit_transform(mine, seen_mm), mine) - seen_mm, axis=1)))
        if off < least:
            best, least = np.array(order, dtype=np.int64), off
    return best if least < NEAR * _apart_mm(seen_mm) else None


def _starts(arm_mm: Array, seen_mm: Array) -> list[Array]:
    """The 24 transforms (4, 4) that align the principal axes of the arm's points with those of the measured ones."""
    arm_middle, seen_middle = arm_mm.mean(axis=0), seen_mm.mean(axis=0)
    arm_axes = np.linalg.svd(arm_mm - arm_middle, full_matrices=False)[2]
    seen_axes = np.linalg.svd(seen_mm - seen_middle, full_matrices=False)[2]
    out = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        turn = seen_axes.T @ (np.array(signs)[:, None] * np.eye(3)[list(order)]) @ arm_axes
        if np.linalg.det(turn) > 0.0:
            out.append(make_transform(turn, seen_middle - turn @ arm_middle))
    return out
