"""Residuals of points and of all distances between them, with the scanner frame of each setup unknown."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib import frames
from calib.array_types import Array, IndexArray
from calib.fitting.observations import (
    linearise_points,
    predict_points,
)
from calib.fitting.observed_residuals import ObservedResiduals
from calib.fitting.residual import Linearisation
from calib.fitting.scanner_frame import frame_columns, orthonormal


@dataclass(frozen=True)
class PositionResiduals(ObservedResiduals):
    """Residuals of points, predicted minus measured, scanner frame, whitened; scanner frames are eliminated.

    The frames are unknowns that enter in closed form, so they are eliminated (variable projection, Golub and Pereyra
    1973, in Kaufman's form): their columns are projected out of the Jacobian, and the solver never sees them.
    """

    frame_known: bool = False  # True: points are given in the base frame (Park 2022)

    @cached_property
    def _whiten(self) -> Array:
        return self.observed.whiten

    @cached_property
    def degrees_spent(self) -> int:
        points_mm = self.observed.points.xyz_mm
        return sum(self._frame_basis(points_mm[rows], rows).shape[1] for rows in self._setup_rows)

    def _frame(self, base_mm: Array, rows: IndexArray) -> Array:
        if self.frame_known:
            return np.eye(4)
        return self.observed.fit_frame(base_mm, rows)

    def _frame_basis(self, scanner_mm: Array, rows: IndexArray) -> Array:
        """Orthonormal basis (C M, rank) of the residual's changes by motions of one setup's scanner frame."""
        if self.frame_known or self.observed.frame_is_known(rows):
            return np.empty((len(rows) * self._whiten.shape[1], 0))
        return orthonormal(frame_columns(scanner_mm, self._whiten[rows]))

    def residual(self, x: Array) -> Array:
        base_mm = predict_points(self.model, x, self.observed)
        out = np.empty(self._whiten.shape[:2])
        for rows in self._setup_rows:
            error_mm = frames.apply(self._frame(base_mm, rows), base_mm[rows]) - self.observed.points.xyz_mm[rows]
            out[rows] = np.einsum("mij,mj->mi", self._whiten[rows], error_mm)
        return out.ravel()

    def linearise(self, x: Array) -> Linearisation:
        base_mm, by_x = linearise_points(self.model, x, self.observed)
        points, coordinates = self._whiten.shape[:2]
        residual = np.empty((points, coordinates))
        jacobian = np.empty((points, coordinates, by_x.shape[-1]))
        for rows in self._setup_rows:
            scanner_T_base = self._frame(base_mm, rows)
            at_mm = frames.apply(scanner_T_base, base_mm[rows])
            error_mm = at_mm - self.observed.points.xyz_mm[rows]
            residual[rows] = np.einsum("mij,mj->mi", self._whiten[rows], error_mm)
            columns = (self._whiten[rows] @ scanner_T_base[:3, :3] @ by_x[rows]).reshape(-1, by_x.shape[-1])
            basis = self._frame_basis(at_mm, rows)
            jacobian[rows] = (columns - basis @ (basis.T @ columns)).reshape(len(rows), coordinates, -1)
        return Linearisation(residual.ravel(), jacobian.reshape(-1, by_x.shape[-1]))

    def base_to_residual(self, x: Array) -> Array:
        """Matrices (M, C, 3) that turn a point's change, mm in the base frame, into whitened residual rows."""
        base_mm = predict_points(self.model, x, self.observed)
        out = np.empty_like(self._whiten)
        for rows in self._setup_rows:
            out[rows] = self._whiten[rows] @ self._frame(base_mm, rows)[:3, :3]
        return out

    def frame_directions(self, x: Array) -> Array:
        """Orthonormal basis (C M, `degrees_spent`) of the residual's changes by motions of all scanner frames."""
        base_mm = predict_points(self.model, x, self.observed)
        blocks, coordinates = [], self._whiten.shape[1]
        for rows in self._setup_rows:
            at_mm = frames.apply(self._frame(base_mm, rows), base_mm[rows])
            basis = self._frame_basis(at_mm, rows)
            block = np.zeros((len(base_mm), coordinates, basis.shape[1]))
            block[rows] = basis.reshape(len(rows), coordinates, -1)
            blocks.append(block.reshape(coordinates * len(base_mm), -1))
        return np.concatenate(blocks, axis=1)


@dataclass(frozen=True)
class PairResiduals(PositionResiduals):
    """Residuals of the distances between all points of a setup, weighted by the inverse of their joint covariance.

    N points have N (N - 1) / 2 distances, of which 3 N - 6 are independent: moving the points rigidly changes none. To
    first order the distances are D dp, D the (singular) matrix of unit vectors, their covariance is D C D^T, and

        (D e)^T (D C D^T)^+ (D e) = min over rigid motions m of (e - F m)^T C^-1 (e - F m)

    for point errors e and the columns F of a rigid motion: generalised least squares on all distances is the same as
    least squares on the points with a free frame, and is computed as that, at linear cost in time and memory. Distances
    taken as independent would count each point's error N - 1 times and give far too small sigmas.
    """
