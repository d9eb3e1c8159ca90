"""What makes a residual white where single points' covariances do not: correlation in time, and tails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Poses
from calib.fitting.noise.student import student_weights
from calib.fitting.noise.time_correlation import Moments, decorrelated
from calib.noise_shape import NoiseShape


@dataclass(frozen=True)
class Whitening:
    """A linear map of the rows of M points, three a point."""

    order: IndexArray  # (M,) in which the points were measured
    root: Array | None  # (M, M) lower triangular, of `Moments.decorrelator`; None without correlation
    weights: Array | None = None  # (M,) under heavy tails
    tail: float | None = None  # degrees of freedom of these

    @classmethod
    def of(cls, shape: NoiseShape, poses: Poses, row: IndexArray, residual: Array) -> Whitening | None:
        """The whitening of points at rows (M,) of the poses, by their residual (3 M,); None where they are white."""
        if shape.wander is None and shape.tail is None:
            return None
        moments = Moments.of(poses, row)
        root = None if shape.wander is None else moments.decorrelator(shape.wander)
        plain = cls(moments.order, root)
        if shape.tail is None:
            return plain
        square = np.sum(plain.apply(residual[:, None]).reshape(-1, 3) ** 2, axis=1)
        return cls(moments.order, root, student_weights(square, shape.tail), shape.tail)

    def apply(self, columns: Array) -> Array:
        """(R, K) of columns (R, K) that are whitened point by point."""
        rows = columns.reshape(len(columns) // 3, 3, columns.shape[1])
        if self.root is not None:
            rows = decorrelated(rows, self.root, self.order)
        if self.weights is not None:
            rows = rows * np.sqrt(self.weights)[:, None, None]
        return np.asarray(rows.reshape(columns.shape))

    def unweighted(self, residual: Array) -> Array:
        """A white residual (3 M,) without the weights: as large as it is."""
        if self.weights is None:
            return residual
        return np.asarray((residual.reshape(-1, 3) / np.sqrt(self.weights)[:, None]).ravel())

    def with_tails(self, normal: Array, rng: np.random.Generator) -> Array:
        """Normal noise (3 M, D) as noise with these tails: each point divided by the root of its own chi^2 over nu."""
        if self.tail is None:
            return normal
        rows = normal.reshape(-1, 3, normal.shape[1])
        divided = np.sqrt(rng.chisquare(self.tail, (len(rows), normal.shape[1])) / self.tail)
        return np.asarray((rows / divided[:, None, :]).reshape(normal.shape))
