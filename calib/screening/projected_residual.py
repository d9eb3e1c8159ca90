"""The residual of a fit with the fitted directions projected out, and its changes by motions of joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.pose_errors import directions_at
from calib.calibration.result import Calibration
from calib.effects.effect import is_held_by_prior
from calib.effects.state import RobotState
from calib.errors import FitError
from calib.fitting.model import point_by_state
from calib.fitting.noise import Whitening
from calib.fitting.observations import Observations, with_scanner_frames
from calib.fitting.position_residuals import PositionResiduals
from calib.screening.nuisance import Nuisance, load_columns

_KNOWN = 0.1  # a direction counts as fitted where the data determine it a tenth as well as the prior, or better
_SHARED_SHOWS = 0.1  # change of the whitened residual by one sigma of an error of all points, from which it counts
_MOST_POSES_KEPT = 5000
_MANY_ROWS = 600
_KNOWN_OF_CURVES = 1.0  # with learned curves, which may have more parameters than there are equations


@dataclass(frozen=True)
class ProjectedResidual(Brief):
    """Whitened residual of a fit with the fitted directions projected out, and these directions.

    N used poses, M measured points, R = 3 M rows (M of lengths), P parameters, S entries of the state.
    """

    residuals: PositionResiduals
    x: Array  # (P,)
    states: Mapping[str, RobotState]  # by target, of the used poses
    by_state: Mapping[str, Array]  # by target (N, 3, S): derivative of the point by the state
    base_to_residual: Array  # (M, 3, 3); (M, 1, 3) of lengths
    residual: Array  # (R,) projected, white given the nuisance
    basis: Array  # (R, rank) orthonormal: fitted parameters, frames and errors that all points share
    dof: int  # degrees of freedom
    nuisance: Nuisance | None = None  # uncertainty of the effects in the model
    whitening: Whitening | None = None  # beyond the points' own covariances; residual and basis have it

    @property
    def state(self) -> RobotState:
        """Robot state at the used poses, for the first target."""
        return next(iter(self.states.values()))

    @property
    def row_poses(self) -> tuple[str, ...]:
        """Pose id (R,) of each row of the residual."""
        poses, row = self.residuals.observed.used_poses
        return tuple(poses.ids[i] for i in row for _ in range(self.coordinates))

    @property
    def coordinates(self) -> int:
        """Number of rows of each point: 3, or 1 of a length."""
        return self.residuals.observed.points.coordinates

    @property
    def sigma(self) -> float:
        """Residual sigma over the declared one."""
        return float(np.sqrt(self.residual @ self.residual / self.dof))

    def project(self, columns: Array) -> Array:
        """Whitened columns (R, K) with the directions projected out in which the fit absorbs errors."""
        return columns - self.basis @ (self.basis.T @ columns)

    def visible(self, columns: Array) -> Array:
        """Columns (R, K) as the residual shows them: whitened, fitted directions out, uncertain ones scaled."""
        columns = columns if self.whitening is None else self.whitening.apply(columns)
        directions, less = self._removed
        return columns - directions @ (less[:, None] * (directions.T @ columns))

    @cached_property
    def _removed(self) -> tuple[Array, Array]:
        """Orthonormal directions (R, K), fitted and uncertain ones, and the share (K,) of each that is taken away."""
        fitted = np.ones(self.basis.shape[1])
        if self.nuisance is None:
            return self.basis, fitted
        uncertain = self.nuisance.directions
        return np.concatenate([self.basis, uncertain], axis=1), np.concatenate([fitted, self.nuisance.removed])

    def in_free(self, columns: Array) -> Array:
        """Projected columns (R, K), or a residual (R,), by fewer rows of the same lengths and angles, where these help.

        They are coordinates in the directions that the fit leaves free.
        """
        free = self._free_directions
        return columns if free is None else np.asarray(free.T @ columns)

    @cached_property
    def _free_directions(self) -> Array | None:
        """Orthonormal directions (R, R - rank) besides the fitted ones; None for many rows, of which few would go."""
        if len(self.basis) > _MANY_ROWS:
            return None
        return np.linalg.qr(self.basis, mode="complete")[0][:, self.basis.shape[1] :]

    def motion_columns(self, direction: Array, motion: Array) -> Array:
        """Changes (R, K) of the projected residual by K motions (N, K) of a joint at the used poses.

        direction  # (M, 3) displacement of each point by a unit motion, whitened
        """
        row = self.residuals.observed.used_poses[1]
        moved = direction[:, :, None] * motion[row][:, None, :]
        return self.visible(moved.reshape(-1, motion.shape[1]))


def project_residual(calibration: Calibration) -> ProjectedResidual:
    """Projected residual of a calibration's measured positions, whichever kind of residual was fitted.

    Screening, curves, gains and tests of one fit ask for it in turn, so the latest few are kept, unless they are large.

    Raises FitError where no degree of freedom is left.
    """
    few = len(calibration.fitted_dataset.poses) <= _MOST_POSES_KEPT
    return _kept_projection(calibration) if few else _projected(calibration)


@lru_cache(maxsize=4)
def _kept_projection(calibration: Calibration) -> ProjectedResidual:
    return _projected(calibration)


def _projected(calibration: Calibration) -> ProjectedResidual:
    model, x, dataset = calibration.model, calibration.fit.x, calibration.fitted_dataset
    observed = with_scanner_frames(Observations.of(dataset), model, x)
    residuals = PositionResiduals(model, observed)
    at = residuals.linearise(x)
    frames = _with_shared_errors(residuals.frame_directions(x), observed)
    scaled = at.jacobian * model.scales
    residual = at.residual
    whitening = None if dataset.noise is None else Whitening.of(dataset.noise, *observed.used_poses, residual)
    if whitening is not None:
        residual, scaled = whitening.apply(residual[:, None])[:, 0], whitening.apply(scaled)
        frames = np.linalg.qr(whitening.apply(frames))[0]
    scaled = scaled - frames @ (frames.T @ scaled)
    q, triangle = np.linalg.qr(scaled)
    turn, s, _ = np.linalg.svd(triangle)  # of a few rows, however many poses there are
    noise = calibration.fit.reduced_chi if np.isfinite(calibration.fit.reduced_chi) else 1.0
    least = _KNOWN_OF_CURVES if any(map(is_held_by_prior, model.effects)) else _KNOWN
    known = s > max(least * noise, 1e-9 * float(s[0]))
    basis = np.linalg.qr(np.concatenate([frames, q @ turn[:, known]], axis=1))[0]
    dof = len(residual) - basis.shape[1]
    if dof < 3:
        raise FitError(
            f"dataset {dataset.name}: {len(residual)} equations and {basis.shape[1]} fitted directions leave "
            "nothing to judge a further cause by; measure more poses"
        )
    residual = residual - basis @ (basis.T @ residual)
    base_to_residual = residuals.base_to_residual(x)
    loads = load_columns(residuals, x, base_to_residual)
    if whitening is not None:
        loads = whitening.apply(loads)
    nuisance = Nuisance.of(loads - basis @ (basis.T @ loads), residual, dof)
    if nuisance is not None:
        residual = nuisance.whitened(residual)
    poses = observed.used_poses[0]
    targets = list(map(str, np.unique(observed.points.target)))
    states = {target: model.state(x, poses, observed.seen(target)) for target in targets}
    return ProjectedResidual(
        residuals=residuals,
        x=x,
        states=states,
        by_state={target: point_by_state(state, target)[1] for target, state in states.items()},
        base_to_residual=base_to_residual,
        residual=residual,
        basis=basis,
        dof=dof,
        nuisance=nuisance,
        whitening=whitening,
    )


def _with_shared_errors(frames: Array, observed: Observations) -> Array:
    """Orthonormal directions (R, F) of the scanner frames, and (R, F + K) with errors that all points share added.

    Errors of a lens that was found from the images are unknowns of the fit of full poses. The places alone tell little
    of their size, so that their directions are no evidence of a cause.
    """
    points = observed.points
    if points.shared is None or not points.shared.shape[2]:
        return frames
    changes = (observed.whiten @ points.shared[:, :3]).reshape(len(frames), -1)
    changes = changes - frames @ (frames.T @ changes)
    ways, size, _ = np.linalg.svd(changes, full_matrices=False)
    return np.concatenate([frames, ways[:, size > _SHARED_SHOWS]], axis=1)


def joint_directions(projected: ProjectedResidual) -> list[Array]:
    """For each joint, the whitened displacement (M, 3) of the points by a unit motion: mm/rad or mm/mm, over sigma."""
    residuals = projected.residuals
    return directions_at(residuals.model, projected.x, residuals.observed, projected.base_to_residual)
