"""What a model is known to miss, as a variance that grows with the distance from the poses that it was fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.brief import Brief

_MANY_PAIRS = 10_000_000  # of poses, from which a tree finds the nearest


@dataclass(frozen=True, eq=False)
class Discrepancy(Brief):
    """Variance per coordinate of what a model is known to miss: a + b r, r the distance to the nearest training pose.

    The distance of two joint vectors is the root mean square over the joints of their difference, each over its scale.
    """

    constant_mm2: float  # a
    growth_mm2: float  # b
    trained: Array  # (T, n) joint vectors of the training poses, rad or mm
    scale: Array  # (n,) range of each joint over them, rad or mm

    def distance(self, q: Array) -> Array:
        """Distance (N,) of joint vectors (N, n) from the nearest training pose."""
        if len(q) * len(self.trained) > _MANY_PAIRS:
            from scipy.spatial import cKDTree  # of so many poses only: it takes a while to load

            nearest = cKDTree(self.trained / self.scale).query(q / self.scale)[0]
            return np.asarray(nearest / np.sqrt(self.trained.shape[1]))
        return np.array([distances(joints, self.trained, self.scale).min() for joints in q])

    def variance_mm2(self, q: Array) -> Array:
        """Variance (N,) per coordinate at joint vectors (N, n)."""
        return np.asarray(self.constant_mm2 + self.growth_mm2 * self.distance(q))


def distances(q: Array, others: Array, scale: Array) -> Array:
    """Distance (N,) of a joint vector (n,) from others (N, n): RMS over the joints, each over its scale."""
    return np.asarray(np.sqrt(np.mean(((others - q) / scale) ** 2, axis=-1)))
