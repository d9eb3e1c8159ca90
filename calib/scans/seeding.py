"""A generator of random numbers that follows from a scan's points: the same scan gives the same result, wherever."""

from __future__ import annotations

from hashlib import blake2b

import numpy as np

from calib.array_types import Array


def seeded(points_mm: Array) -> np.random.Generator:
    """Seeded by some ten thousand of the points (N, 3), and their number."""
    some = points_mm[:: max(1, len(points_mm) // 10_000)]
    content = np.ascontiguousarray(some, dtype=np.float64).tobytes() + str(len(points_mm)).encode()
    return np.random.default_rng(int.from_bytes(blake2b(content, digest_size=8).digest(), "big"))
