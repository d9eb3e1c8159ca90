"""Which points of a large scan lie near a place."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array, IndexArray

_AT_A_TIME = 32_768  # points; a processor's own memory holds them through all steps


def points_within(points_mm: Array, centre_mm: Array, radius_mm: float) -> tuple[IndexArray, Array]:
    """Indices of the points (N, 3) within a radius of a place (3,), ascending, and their way (K, 3) from there.

    A point that is not finite is near nothing.
    """
    parts = []
    ones = np.ones(3)
    most = radius_mm**2 - float(centre_mm @ centre_mm)
    for start in range(0, len(points_mm), _AT_A_TIME):
        some = points_mm[start : start + _AT_A_TIME]
        with np.errstate(invalid="ignore", over="ignore"):
            # |p|^2 - 2 p . c, as two products with matrices: a difference of rows takes five times as long.
            squared = (some * some) @ ones - some @ (2 * centre_mm)
            parts.append(np.flatnonzero(squared < most) + start)
    near = np.concatenate([*parts, np.zeros(0, dtype=np.int64)])
    return near, points_mm.take(near, axis=0) - centre_mm
