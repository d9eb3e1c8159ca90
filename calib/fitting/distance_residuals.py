"""Residuals of distances from a reference pose (Jang 2025 eq 9-16), which need no scanner frame.

`calib.fitting.trust_region` solves them; its full Gauss-Newton step is the pseudo-inverse of Jang eq 16.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array_types import Array, IndexArray
from calib.errors import FitError
from calib.fitting.observations import Observations, mean_jig_points, setup_references
from calib.fitting.observed_residuals import ObservedResiduals
from calib.fitting.residual import Linearisation


@dataclass(frozen=True)
class DistanceResiduals(ObservedResiduals):
    """Residuals of distances between a reference pose and all other poses, predicted minus measured, whitened.

    Jang's row (eq 14), L_M^2 - L_N^2 = 2 (P_k - P_1)^T (J_k - J_1) dX, divided by 2 L: to first order the same
    equation in millimetres, so that long distances do not count more than short ones. All rows share the noise of the
    reference point: divided by the far point's sigma along the line, they have the covariance 1 + U U^T, U (K, 3) the
    unit vectors times the reference's covariance root over that sigma. Rows are multiplied by its inverse root.

    A setup without a reference pose starts from its first usable one. Repeats of a pose are averaged first.
    """

    @property
    def degrees_spent(self) -> int:
        return 0

    @cached_property
    def _setups(self) -> list[_DistanceRows]:
        return _distance_rows(self.observed)

    def residual(self, x: Array) -> Array:
        base_mm = self._predict(x)
        return np.concatenate([rows.whiten(rows.lengths(base_mm) - rows.measured_mm) for rows in self._setups])

    def _predict(self, x: Array) -> Array:
        return self.model.predict(x, self.observed.used_poses[0], seen=self.observed.seen())

    def linearise(self, x: Array) -> Linearisation:
        base_mm, by_x = self.model.linearise(x, self.observed.used_poses[0], seen=self.observed.seen())
        residual, jacobian = [], []
        for rows in self._setups:
            along = base_mm[rows.others] - base_mm[rows.reference]
            length = np.linalg.norm(along, axis=1)
            direction = along / np.maximum(length, 1e-12)[:, None]
            difference = by_x[rows.others] - by_x[rows.reference]
            residual.append(rows.whiten(length - rows.measured_mm))
            jacobian.append(rows.whiten(np.einsum("ki,kip->kp", direction, difference)))
        return Linearisation(np.concatenate(residual), np.concatenate(jacobian))


@dataclass(frozen=True)
class _DistanceRows:
    """K measured distances of one setup: reference pose, other poses, lengths, and what whitens their noise."""

    reference: int
    others: IndexArray  # (K,)
    measured_mm: Array  # (K,)
    sigma_mm: Array  # (K,) of the far point along the line
    shared: Array  # (K, r) left singular vectors of U, the part that all distances share
    shrink: Array  # (r,) 1 - 1 / sqrt(1 + s^2), s the singular values of U

    def lengths(self, base_mm: Array) -> Array:
        return np.linalg.norm(base_mm[self.others] - base_mm[self.reference], axis=1)

    def whiten(self, rows: Array) -> Array:
        """Residual or Jacobian rows (K,) or (K, P), whitened for each distance's own noise and the shared noise."""
        scaled = (rows.T / self.sigma_mm).T
        return scaled - (self.shared * self.shrink) @ (self.shared.T @ scaled)


def _distance_rows(observed: Observations) -> list[_DistanceRows]:
    poses, _ = observed.used_poses
    usable, mean_mm, covariance = mean_jig_points(observed)
    out = []
    for setup, reference in setup_references(poses, usable).items():
        others = np.flatnonzero(usable & (poses.setup == setup) & (np.arange(len(poses)) != reference))
        along = mean_mm[others] - mean_mm[reference]
        measured = np.linalg.norm(along, axis=1)
        others, along, measured = others[measured > 1e-9], along[measured > 1e-9], measured[measured > 1e-9]
        if len(others) == 0:
            continue
        direction = along / measured[:, None]
        sigma = np.sqrt(np.einsum("ki,kij,kj->k", direction, covariance[others], direction))
        root = np.linalg.cholesky(covariance[reference])
        u, s, _ = np.linalg.svd((direction / sigma[:, None]) @ root, full_matrices=False)
        out.append(_DistanceRows(reference, others, measured, sigma, u, 1.0 - 1.0 / np.sqrt(1.0 + s**2)))
    if not out:
        raise FitError("found no two poses of one setup with measured points; a distance needs two")
    return out
