"""Points measured after a calibration, linearised about what the calibration predicts for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from calib import frames
from calib.array_types import Array, IndexArray
from calib.calibration.result import Calibration, declared_sigma_mm
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.dataset import Dataset
from calib.errors import FitError
from calib.extras.watch.change_models import SCANNER, ChangeModel, change_models_of_arm
from calib.extras.watch.change_tests import ChangeTests
from calib.extras.watch.misfit import MOST_POSES, Misfit
from calib.extras.watch.spread import Spread
from calib.fitting.observations import Observations, linearise_points, with_nominal_scanner_frames
from calib.fitting.scanner_frame import fit_scanner_frame, whitener
from calib.statistics import axis_sigma, axis_variances, chi2_sf, rms_length

_FEWEST = 3  # check poses
_SET_UP_ANEW_MM = 50.0  # by which the points move where no knock did it
_FEWEST_DOF = 8.0  # of the noise, whatever its errors are like
_CHANCE = 1e-4  # probability of residuals as small as the fit's, below which the noise is less than declared
_FINEST = 1e-9  # least noise as a share of the largest coordinate: exact data leave nothing but rounding


@dataclass(frozen=True)
class CheckPoints:
    """Points (M) of one check of a cell, with their predictions by an earlier fit of P parameters."""

    observed: Observations
    at_mm: Array  # (M, 3) predicted, base frame
    by_x: Array  # (M, 3, P) derivatives by the fit's parameters, base frame
    whiten: Array  # (M, 3, 3) inverse roots of the points' declared covariances, scanner frame
    anew_T_base: Array  # (4, 4) scanner frame fitted to these points
    models: tuple[ChangeModel, ...]  # of the arm
    station: str
    poses: int  # that were measured

    @classmethod
    def of(cls, base: Calibration, new: Dataset) -> CheckPoints:
        """Linearised points of a check. Raises FitError for too few poses, several stations, lengths."""
        if any(one.points is not None and one.points.lengths is not None for one in (new, base.dataset)):
            raise FitError(f"dataset {new.name}: lengths from anchors are not watched; measured points are needed")
        later = _with_noise_of(base, replace(new, poses=new.poses.measured_later()))
        observed = Observations.of_all(later)
        count = len(np.unique(observed.points.pose))
        if count < _FEWEST:
            raise FitError(f"dataset {new.name}: found {count} measured poses; a check takes {_FEWEST} or more")
        setups = np.unique(observed.setup)
        if len(setups) > 1:
            raise FitError(f"dataset {new.name}: found {len(setups)} placements of the scanner; watch each by itself")
        observed = with_nominal_scanner_frames(observed, base.model.placed_robot)
        at_mm, by_x = linearise_points(base.model, base.fit.x, observed)
        return cls(
            observed=observed,
            at_mm=at_mm,
            by_x=by_x,
            whiten=whitener(observed.covariance_mm2),
            anew_T_base=fit_scanner_frame(at_mm, observed.points.xyz_mm, observed.covariance_mm2),
            models=tuple(change_models_of_arm(base.model, base.fit.x, observed)),
            station=str(setups[0]),
            poses=count,
        )

    @property
    def colour(self) -> Array:
        """Roots (M, 3, 3) of the points' declared covariances, mm."""
        return np.asarray(np.linalg.inv(self.whiten))

    def errors_mm(self, scanner_T_base: Array) -> Array:
        """Measured less predicted points (M, 3), in a scanner frame."""
        return self.observed.points.xyz_mm - frames.apply(scanner_T_base, self.at_mm)

    def scanner_motion(self, scanner_T_base: Array, centre_mm: Array) -> ChangeModel:
        """Change model of the scanner's motion by a shift (mm) and a rotation (rad) about a centre in its frame."""
        motion = frames.frame_motion(frames.apply(scanner_T_base, self.at_mm), centre_mm)
        return ChangeModel(SCANNER, None, "", "mm", scanner_T_base[:3, :3].T @ motion)

    def elsewhere_mm(self, before_T_base: Array) -> float | None:
        """How far the points are, mm, from where an earlier place of the scanner has them; None where it stands there.

        So far no knock moves a scanner: it was set up anew. Three poses tell nothing of it: a frame fits any three.
        """
        if self.poses <= _FEWEST:
            return None
        moved_mm = rms_length(frames.apply(before_T_base, self.at_mm) - frames.apply(self.anew_T_base, self.at_mm))
        return moved_mm if moved_mm > _SET_UP_ANEW_MM else None

    def linearised(self, scanner_T_base: Array, centre_mm: Array) -> tuple[Array, Array, Array]:
        """Whitened residual (3 M,), and its derivatives by x (3 M, P) and by the frame's motion (3 M, 6)."""
        residual = np.einsum("mij,mj->mi", self.whiten, self.errors_mm(scanner_T_base)).ravel()
        in_base = self.whiten @ scanner_T_base[:3, :3]
        moved = self.scanner_motion(scanner_T_base, centre_mm).columns
        return residual, (in_base @ self.by_x).reshape(len(residual), -1), (in_base @ moved).reshape(len(residual), 6)


@dataclass(frozen=True)
class Expectation:
    """Expected errors of later points: noise, uncertainty of the fit and of its scanner frame, misfit."""

    noise: float  # over the declared noise
    dof: float  # of the noise
    misfit: Misfit
    prior: JointKnowledge
    before_T_base: Array | None  # (4, 4) scanner frame of the earlier fit; None where the scanner was set up anew

    @classmethod
    def of(cls, base: Calibration, checks: Sequence[CheckPoints]) -> Expectation:
        """Expected errors of checks at one station, by what the earlier fit knows."""
        station = checks[0].station
        known = station in base.after.scanner_T_base
        known = known and not any(check.elsewhere_mm(base.after.scanner_T_base[station]) for check in checks)
        noise, dof, scale = _noise(base)
        misfit = Misfit.of(base)
        # Errors that are alike, or few of them large, tell less of their size.
        dof = max(dof / (misfit.tails * misfit.inflation), min(dof, _FEWEST_DOF))
        noise = max(noise, *(_finest(check.observed) for check in checks))
        prior = JointKnowledge.of(base, station if known else None)
        prior = replace(prior, covariance=scale**2 * misfit.inflation * prior.covariance)
        return cls(noise, dof, misfit, prior, base.after.scanner_T_base[station] if known else None)

    def tests(self, checks: Sequence[CheckPoints]) -> tuple[ChangeTests, ChangeTests]:
        """Tests of changes by one or more checks: with the scanner's frame fixed, and fitted to each check.

        Where the scanner was set up anew, the first are about the frames of the checks, as the second.
        """
        used, row = _used_joints(checks)
        white = self.noise if self.misfit.inflation <= 1.0 or len(used) > MOST_POSES else min(self.noise, 1.0)
        variances = np.concatenate([axis_variances(c.observed.covariance_mm2) for c in checks])
        root_mm = self.misfit.root_mm(used, (self.noise**2 - white**2) * float(variances.mean()))
        missed = np.kron(root_mm, np.eye(3)).reshape(len(used), 3, -1)[row]  # (M, 3, L) base frame

        def spread(frames_T_base: Sequence[Array], *, free: bool) -> ChangeTests:
            each = list(zip(checks, frames_T_base, strict=True))
            of_each = [check.linearised(frame, self.prior.centre_mm) for check, frame in each]
            residual, columns, motion = (list(parts) for parts in zip(*of_each, strict=True))
            blocks = np.concatenate([check.whiten @ frame[:3, :3] for check, frame in each])
            by_x = np.concatenate(columns)
            own = by_x if free else np.concatenate([by_x, np.concatenate(motion)], axis=1)
            covariance = self.prior.covariance[: own.shape[1], : own.shape[1]]
            alike = (blocks @ missed).reshape(len(own), -1)
            whole = np.asarray(block_diag(covariance, np.eye(alike.shape[1])))
            blind = np.asarray(block_diag(*motion)) if free else None
            known = Spread.of(np.concatenate([own, alike], axis=1), whole, white, blind=blind)
            y = known.whiten(np.concatenate(residual))
            return ChangeTests(y, known, blocks, self.dof, self.misfit.tails)

        anew = [check.anew_T_base for check in checks]
        before = anew if self.before_T_base is None else [self.before_T_base] * len(checks)
        return spread(before, free=False), spread(anew, free=True)


def _with_noise_of(base: Calibration, new: Dataset) -> Dataset:
    """Later points with the noise of the earlier ones, where the noise of either is not declared.

    The fit's residual over it is then the noise as the fit left it.
    """
    points = new.points
    if points is None or (new.declares_noise and base.dataset.declares_noise):
        return new
    scanner = replace(new.scanner, point_sigma_mm=declared_sigma_mm(base.fitted_dataset))
    return replace(new, points=replace(points, covariance_mm2=None), scanner=scanner)


def _used_joints(checks: Sequence[CheckPoints]) -> tuple[Array, IndexArray]:
    """Joints (N, n) of all checks, equal ones once, and the row of each point's pose among them."""
    q = np.concatenate([used.q[row] for used, row in (check.observed.used_poses for check in checks)])
    used, row = np.unique(q, axis=0, return_inverse=True)
    return used, np.asarray(row).ravel()


def _noise(base: Calibration) -> tuple[float, float, float]:
    """Expected noise over the declared noise, its degrees of freedom, and its ratio to the noise of the fit.

    Where the residual is below the declared noise by no more than chance, the declared noise is expected: a fit whose
    residuals happened to be small would take every later noise for a change.
    """
    noise, dof = base.fit.reduced_chi, base.fit.degrees_of_freedom
    if not np.isfinite(noise):
        return 1.0, np.inf, 1.0
    by_chance = noise < 1.0 and 1.0 - chi2_sf(dof * noise**2, dof) > _CHANCE
    return (1.0, dof, 1.0 / noise) if by_chance else (noise, dof, 1.0)


def _finest(observed: Observations) -> float:
    """Least noise, over the declared noise, that rounding of the coordinates allows."""
    farthest_mm = max(float(np.abs(observed.points.xyz_mm).max()), 1.0)
    return _FINEST * farthest_mm / axis_sigma(observed.covariance_mm2)
