"""Residuals: what the solver makes small. Four kinds with one interface; the solver knows none of them.

* `PositionResiduals`: measured points against predicted ones, the scanner's frame of each setup unknown.
* `DistanceResiduals`: distances from a reference pose, which need no frame at all (Jang 2025 eq 9-16).
* `PairResiduals`: the distances between all points of a setup, with the covariance that they really have.
* `PoseResiduals` (`calib.fitting.pose_residuals`): positions, and orientations of the jig where they were measured.

All are whitened: with the declared sigmas right and the model complete, each row has variance 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib import frames
from calib.effects.effect import Array, Parameter
from calib.errors import FitError
from calib.fitting.linearised import Linearised
from calib.fitting.model import Model
from calib.fitting.observations import (
    Observations,
    linearise_points,
    mean_jig_points,
    predict_points,
    setup_references,
)
from calib.fitting.pose_residuals import PoseResiduals
from calib.fitting.scanner_frame import fit_scanner_frame, frame_columns, orthonormal, whitener
from calib.options import RESIDUAL_KINDS


class Residuals(Protocol):
    """What the solver needs to know of a problem."""

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    @property
    def degrees_spent(self) -> int:
        """Unknowns that the residual has solved for by itself (the scanner's frames)."""
        ...

    def residual(self, x: Array) -> Array: ...

    def linearise(self, x: Array) -> Linearised: ...


@dataclass(frozen=True)
class PositionResiduals:
    """Predicted minus measured points in the scanner's frame; each setup's frame is solved for at every x.

    The frames are unknowns that enter in closed form, so they are eliminated (variable projection, Golub and Pereyra
    1973, in Kaufman's form): their columns are projected out of the Jacobian, and the solver never sees them.
    """

    model: Model
    observed: Observations
    frame_known: bool = False  # true: points are given in the base frame, as in Park 2022

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.model.parameters

    @cached_property
    def _setups(self) -> list[NDArray[np.int64]]:
        setup = self.observed.setup
        return [np.flatnonzero(setup == name) for name in np.unique(setup)]

    @cached_property
    def _whiten(self) -> Array:
        return whitener(self.observed.covariance_mm2)

    @cached_property
    def degrees_spent(self) -> int:
        points_mm = self.observed.points.xyz_mm
        return sum(self._frame_basis(points_mm[rows], rows).shape[1] for rows in self._setups)

    def scanner_frames(self, x: Array) -> dict[str, Array]:
        """setup -> scanner_T_base (4, 4) at x."""
        base_mm = predict_points(self.model, x, self.observed)
        return {str(self.observed.setup[rows[0]]): self._frame(base_mm, rows) for rows in self._setups}

    def _frame(self, base_mm: Array, rows: NDArray[np.int64]) -> Array:
        if self.frame_known:
            return np.eye(4)
        observed = self.observed
        return fit_scanner_frame(base_mm[rows], observed.points.xyz_mm[rows], observed.covariance_mm2[rows])

    def _frame_basis(self, scanner_mm: Array, rows: NDArray[np.int64]) -> Array:
        """What a motion of the setup's frame can do to its whitened residual: orthonormal (3 M, rank)."""
        if self.frame_known:
            return np.empty((3 * len(rows), 0))
        return orthonormal(frame_columns(scanner_mm, self._whiten[rows]))

    def residual(self, x: Array) -> Array:
        base_mm = predict_points(self.model, x, self.observed)
        out = np.empty_like(base_mm)
        for rows in self._setups:
            error_mm = (
                frames.apply(self._frame(base_mm, rows), base_mm[rows]) - self.observed.points.xyz_mm[rows]
            )
            out[rows] = np.einsum("mij,mj->mi", self._whiten[rows], error_mm)
        return out.ravel()

    def linearise(self, x: Array) -> Linearised:
        base_mm, by_x = linearise_points(self.model, x, self.observed)
        residual = np.empty_like(base_mm)
        jacobian = np.empty_like(by_x)
        for rows in self._setups:
            scanner_T_base = self._frame(base_mm, rows)
            at_mm = frames.apply(scanner_T_base, base_mm[rows])
            error_mm = at_mm - self.observed.points.xyz_mm[rows]
            residual[rows] = np.einsum("mij,mj->mi", self._whiten[rows], error_mm)
            columns = (self._whiten[rows] @ scanner_T_base[:3, :3] @ by_x[rows]).reshape(-1, by_x.shape[-1])
            basis = self._frame_basis(at_mm, rows)
            jacobian[rows] = (columns - basis @ (basis.T @ columns)).reshape(len(rows), 3, -1)
        return Linearised(residual.ravel(), jacobian.reshape(-1, by_x.shape[-1]))

    def base_to_residual(self, x: Array) -> Array:
        """(M, 3, 3) from a change of each predicted point, mm in the base frame, to the residual's rows."""
        base_mm = predict_points(self.model, x, self.observed)
        out = np.empty((len(base_mm), 3, 3))
        for rows in self._setups:
            out[rows] = self._whiten[rows] @ self._frame(base_mm, rows)[:3, :3]
        return out

    def frame_directions(self, x: Array) -> Array:
        """What motions of the scanner's frames do to the residual: orthonormal columns (3 M, `degrees_spent`)."""
        base_mm = predict_points(self.model, x, self.observed)
        blocks = []
        for rows in self._setups:
            at_mm = frames.apply(self._frame(base_mm, rows), base_mm[rows])
            basis = self._frame_basis(at_mm, rows)
            block = np.zeros((len(base_mm), 3, basis.shape[1]))
            block[rows] = basis.reshape(len(rows), 3, -1)
            blocks.append(block.reshape(3 * len(base_mm), -1))
        return np.concatenate(blocks, axis=1)


@dataclass(frozen=True)
class DistanceResiduals:
    """Distances between a reference pose and all others, predicted minus measured.

    Jang's row (eq 14), L_M^2 - L_N^2 = 2 (P_k - P_1)^T (J_k - J_1) dX, divided by 2 L: to first order the same
    equation in millimetres, so that long distances do not count more than short ones. All rows share the noise of the
    reference point; their covariance 1 + U U^T (U: the unit vectors) is whitened away at linear cost.
    """

    model: Model
    observed: Observations

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self.model.parameters

    @property
    def degrees_spent(self) -> int:
        return 0

    @cached_property
    def _setups(self) -> list[_DistanceRows]:
        return _distance_rows(self.observed)

    def residual(self, x: Array) -> Array:
        base_mm = self._predict(x)
        return np.concatenate(
            [rows.whiten(rows.lengths(base_mm) - rows.measured_mm) for rows in self._setups]
        )

    def _predict(self, x: Array) -> Array:
        return self.model.predict(x, self.observed.used_poses[0], seen=self.observed.seen())

    def linearise(self, x: Array) -> Linearised:
        base_mm, by_x = self.model.linearise(x, self.observed.used_poses[0], seen=self.observed.seen())
        residual, jacobian = [], []
        for rows in self._setups:
            along = base_mm[rows.others] - base_mm[rows.reference]
            length = np.linalg.norm(along, axis=1)
            direction = along / np.maximum(length, 1e-12)[:, None]
            difference = by_x[rows.others] - by_x[rows.reference]
            residual.append(rows.whiten(length - rows.measured_mm))
            jacobian.append(rows.whiten(np.einsum("ki,kip->kp", direction, difference)))
        return Linearised(np.concatenate(residual), np.concatenate(jacobian))


@dataclass(frozen=True)
class _DistanceRows:
    """The distances of one setup: rows of the used poses, measured lengths and how to whiten them."""

    reference: int
    others: NDArray[np.int64]  # (K,)
    measured_mm: Array  # (K,)
    sigma_mm: Array  # (K,) of the far point along the line
    shared: Array  # (K, r) U S^-1 ... left singular vectors of the shared part
    shrink: Array  # (r,) 1 - 1 / sqrt(1 + s^2)

    def lengths(self, base_mm: Array) -> Array:
        return np.linalg.norm(base_mm[self.others] - base_mm[self.reference], axis=1)

    def whiten(self, rows: Array) -> Array:
        """(1 + U U^T)^(-1/2) applied to rows (K,) or (K, P), after division by each row's own sigma."""
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


@dataclass(frozen=True)
class PairResiduals(PositionResiduals):
    """The distances between all points of a setup, weighted by the inverse of their joint covariance.

    N points have N (N - 1) / 2 distances, of which 3 N - 6 are independent: moving the points rigidly changes none. To
    first order the distances are D dp, D the (singular) matrix of unit vectors, their covariance is D C D^T, and

        (D e)^T (D C D^T)^+ (D e) = min over rigid motions m of (e - F m)^T C^-1 (e - F m)

    for point errors e and the columns F of a rigid motion: generalised least squares on all distances *is* least
    squares on the points with a free frame. So it is computed as such, at linear cost in time and memory. Taken as
    independent, all distances count each point's error N - 1 times and promise far too much.
    """


def make_residuals(
    kind: str, model: Model, observed: Observations
) -> PositionResiduals | DistanceResiduals | PoseResiduals:
    """Residuals by their name on the command line. Raises FitError on another name."""
    if kind == "pairs":
        return PairResiduals(model, observed)
    if kind == "position":
        return PositionResiduals(model, observed)
    if kind == "distance":
        return DistanceResiduals(model, observed)
    if kind == "pose":
        return PoseResiduals(model, observed)
    raise FitError(f"no residual named {kind!r}; there are {' and '.join(RESIDUAL_KINDS)}")
