"""Likelihood of a noise shape, from the residual of a fit or from the scatter of repeats.

Restricted likelihood (Patterson and Thompson 1971): with whitened residual y, fitted directions X, and noise of
covariance s^2 C, s unknown,

    l(C) = -1/2 log det C - 1/2 log det(X^T C^-1 X) - nu/2 log(y^T C^-1 (y - X b)),   b by generalised least squares.

So a point that the fit follows closely (leverage) is not taken for a quiet one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import repeat_groups
from calib.fitting.noise import Moments, decorrelated, inverse_factors, noise_factors, student_weights
from calib.fitting.observations import Observations
from calib.fitting.scanner_frame import whitener
from calib.noise_shape import CorrelatedDrift, NoiseShape
from calib.screening.projected_residual import ProjectedResidual
from calib.statistics import group_numbers

ENOUGH_DIFFERENCES = 24  # of repeats: as many show the shape, and where they show none there is none


@dataclass(frozen=True)
class LinearResidual:
    """Whitened residual of a linear fit at M points, with the F directions in which the fit absorbs errors.

    Residual and directions are in units of the declared noise.
    """

    xyz_mm: Array  # (M, 3) scanner frame
    whiten: Array  # (M, C, 3), C coordinates of each point, 1 of a length
    rows: Array  # (M, C, 1 + F) the residual, then the fitted directions
    moments: Moments

    @classmethod
    def of(cls, projected: ProjectedResidual) -> LinearResidual:
        """The residual of a fit under the declared noise."""
        observed = projected.residuals.observed
        poses, row = observed.used_poses
        residual, fitted = projected.residual, projected.basis
        if projected.nuisance is not None:  # what is uncertain about the model is no noise
            residual = projected.nuisance.coloured(residual)
            fitted = np.column_stack([fitted, projected.nuisance.directions])
        both = np.column_stack([residual, fitted])
        return cls(
            observed.points.xyz_mm,
            observed.whiten,
            both.reshape(len(row), observed.points.coordinates, -1),
            Moments.of(poses, row),
        )

    def select(self, keep: IndexArray) -> LinearResidual:
        """This residual restricted to some of the points."""
        moments = self.moments.select(keep)
        return LinearResidual(self.xyz_mm[keep], self.whiten[keep], self.rows[keep], moments)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residual."""
        return self.rows[..., 0].size - self.rows.shape[2] + 1

    def log_likelihood(self, shape: NoiseShape, weights: Array | None = None) -> float:
        """Log likelihood of a noise shape given this residual, up to a constant that depends on the weights (M,)."""
        if shape.wander is not None:
            return self.log_likelihoods(shape, (shape.wander,), weights)[0]
        rows, log_det = self._in_units_of(shape, weights)
        flat = rows.reshape(-1, rows.shape[2])
        return _restricted(flat.T @ flat, self.dof) - log_det

    def log_likelihoods(
        self, shape: NoiseShape, drifts: Sequence[CorrelatedDrift], weights: Array | None = None
    ) -> list[float]:
        """Log likelihood of a noise shape with its drift replaced by each of several correlated drifts."""
        rows, log_det = self._in_units_of(shape, weights)
        return [
            _restricted(products, self.dof) - log_det - 0.5 * rows.shape[1] * of_time
            for products, of_time in self.moments.products(drifts, rows)
        ]

    def standardised(self, shape: NoiseShape) -> Array:
        """Residuals (M, 3), each over its own sigma after the fit; white if the noise has the given shape."""
        rows, _ = self._in_units_of(shape)
        if shape.wander is not None:
            rows = decorrelated(rows, self.moments.decorrelator(shape.wander), self.moments.order)
        count, coordinates = rows.shape[:2]
        basis = np.linalg.qr(rows[:, :, 1:].reshape(count * coordinates, -1))[0]
        residual = rows[:, :, 0].ravel() - basis @ (basis.T @ rows[:, :, 0].ravel())
        blocks = basis.reshape(count, coordinates, -1)
        size, turn = np.linalg.eigh(np.eye(coordinates) - blocks @ np.swapaxes(blocks, 1, 2))
        along = np.einsum("mji,mj->mi", turn, residual.reshape(count, coordinates)) / np.sqrt(np.maximum(size, 0.05))
        return np.einsum("mij,mj->mi", turn, along)

    def weights(self, shape: NoiseShape) -> Array | None:
        """Weights (M,) of the points under the noise shape's heavy tails; None for a shape without heavy tails."""
        if shape.tail is None:
            return None
        return student_weights(np.sum(self.standardised(shape) ** 2, axis=1), shape.tail)

    def normalised(self, shape: NoiseShape) -> NoiseShape:
        """A noise shape scaled so that the mean variance of these points equals the declared one."""
        if self.whiten.shape[1] == 1:  # of lengths, whose noise has no shape but in time
            return replace(shape, scale=1.0)
        plain = np.linalg.inv(self.whiten)
        shaped = noise_factors(shape, self.xyz_mm) @ plain
        return replace(shape, scale=shape.scale * float(np.sqrt(np.sum(plain**2) / np.sum(shaped**2))))

    @cached_property
    def _is_isotropic(self) -> bool:
        return bool(np.allclose(self.whiten, self.whiten[:, :1, :1] * np.eye(3), rtol=1e-9, atol=0.0))

    def _in_units_of(self, shape: NoiseShape, weights: Array | None = None) -> tuple[Array, float]:
        """Residual and fitted directions over a shape's noise of single points, and half its log determinant."""
        rows, log_det = self.rows, 0.0
        if shape.reshapes_points:
            inverse, log_det = inverse_factors(shape, self.xyz_mm)
            if not self._is_isotropic:
                inverse = self.whiten @ inverse @ np.linalg.inv(self.whiten)
            rows = inverse @ rows
        return rows if weights is None else rows * np.sqrt(weights)[:, None, None], log_det


def _restricted(products: Array, dof: int) -> float:
    """Restricted log likelihood -1/2 log det(X^T X) - nu/2 log |y - X b|^2, from the products of y and X."""
    information, along, square = products[1:, 1:], products[1:, 0], float(products[0, 0])
    if not len(along):
        return -0.5 * dof * float(np.log(max(square, 1e-300)))
    jitter = 1e-12 * float(np.trace(information)) / len(along)
    root = np.linalg.cholesky(information + jitter * np.eye(len(along)))
    fitted = np.linalg.solve(root, along)
    rest = max(square - float(fitted @ fitted), 1e-12 * square, 1e-300)
    return -float(np.sum(np.log(np.diag(root)))) - 0.5 * dof * float(np.log(rest))


def scatter_of_repeats(dataset: Dataset) -> LinearResidual | None:
    """Scatter of repeated measurements about their mean, as k - 1 independent differences of k repeats.

    It is noise, whatever the arm does. None with fewer than `ENOUGH_DIFFERENCES`. Rows that were written twice carry no
    information and are left out.
    """
    points = dataset.points
    if points is None:
        return None
    target = group_numbers(points.target)
    key = np.column_stack([repeat_groups(dataset)[points.pose], target])
    place = group_numbers(key)
    if len(points) - len(np.unique(place)) < ENOUGH_DIFFERENCES:
        return None
    observed = Observations.of_all(dataset)
    covariance = observed.covariance_mm2 * (1.0 if points.counts_as is None else points.counts_as[:, None, None])
    differences: list[Array] = []
    rows: list[int] = []
    for repeats in np.split(np.argsort(place, kind="stable"), np.cumsum(np.bincount(place))[:-1]):
        xyz_mm, first = np.unique(np.round(points.xyz_mm[repeats], 9), axis=0, return_index=True)
        if len(xyz_mm) > 1:
            differences.append(_contrasts(len(xyz_mm)) @ points.xyz_mm[repeats[np.sort(first)]])
            rows += repeats[: len(xyz_mm) - 1].tolist()
    if len(rows) < ENOUGH_DIFFERENCES:
        return None
    whiten = whitener(covariance[rows])
    residual = np.einsum("mij,mj->mi", whiten, np.concatenate(differences))
    moments = Moments.of(dataset.poses, points.pose[rows])
    return LinearResidual(points.xyz_mm[rows], whiten, residual[:, :, None], moments)


def _contrasts(count: int) -> Array:
    """Orthonormal rows (count - 1, count), each of which takes a difference of repeats (Helmert contrasts)."""
    full = np.linalg.qr(np.column_stack([np.ones(count), np.eye(count)[:, 1:]]))[0]
    return np.asarray(full[:, 1:].T)
