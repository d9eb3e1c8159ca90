"""Tests for changes of a cell: new points against an earlier fit, with the scanner frame fixed or fitted anew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.calibration.uncertainty import JointKnowledge
from calib.dataset.dataset import Dataset
from calib.distributions import chi2_sf
from calib.errors import FitError
from calib.fitting.observations import Observations, linearise_points, with_nominal_scanner_frames
from calib.fitting.scanner_frame import fit_scanner_frame, frame_motion, whitener
from calib.monitoring.change_models import BASE, LARGEST_BY_UNIT, SCANNER, ChangeModel, change_models_of_arm
from calib.monitoring.change_tests import (
    ALARM,
    ALONE,
    NAMED_GIVEN_OTHERS,
    Change,
    ChangeTests,
    confounded_with,
    most_likely,
)
from calib.monitoring.check_errors import CheckErrors
from calib.monitoring.misfit import MOST_POSES, Misfit
from calib.monitoring.prediction_spread import Spread

_FEWEST = 3  # check poses
_HIDDEN = 10.0  # times the RMSE, by which a change has to move the points to be refused where it is large
_FEWEST_DOF = 8.0  # of the noise, whatever its errors are like
_CHANCE = 1e-4  # probability of residuals as small as the fit's, below which the noise is less than declared
_FINEST = 1e-9  # least noise as a share of the largest coordinate: exact data leave nothing but rounding


@dataclass(frozen=True)
class CellTests:
    """Tests for changes of a cell, with the scanner at its earlier place (`fixed`) or fitted anew (`free`)."""

    models: tuple[ChangeModel, ...]  # of the arm
    scanner: ChangeModel
    fixed: ChangeTests
    free: ChangeTests
    scanner_known: bool  # whether the earlier fit knows the scanner's station, and it was not set up anew
    errors: CheckErrors
    rmse_free_mm: float  # 3D, of the new points with the scanner's frame fitted anew
    expected_mm: float  # RMS, 3D, of the expected noise
    poses: int
    confounded_with_scanner: tuple[str, ...]  # the base's motion, for a scanner that stands in the world

    @classmethod
    def of(cls, base: Calibration, new: Dataset, *, scanner_moved: bool) -> CellTests:
        """Tests of new points against an earlier calibration. Raises FitError for too few poses."""
        later = replace(new, poses=new.poses.measured_later())
        observed = Observations.of(later, np.ones(len(new.poses), dtype=bool))
        count = len(np.unique(observed.points.pose))
        if count < _FEWEST:
            raise FitError(f"dataset {new.name}: found {count} measured poses; a check takes {_FEWEST} or more")
        setups = np.unique(observed.setup)
        if len(setups) > 1:
            raise FitError(f"dataset {new.name}: found {len(setups)} placements of the scanner; watch each by itself")
        known = not scanner_moved and str(setups[0]) in base.after.scanner_T_base
        observed = with_nominal_scanner_frames(observed, base.model.placed_robot)
        at_mm, by_x = linearise_points(base.model, base.fit.x, observed)
        whiten = whitener(observed.covariance_mm2)
        measured_mm = observed.points.xyz_mm
        anew = fit_scanner_frame(at_mm, measured_mm, observed.covariance_mm2)
        before = base.after.scanner_T_base[str(setups[0])] if known else anew
        noise, dof, scale = _noise(base)
        misfit = Misfit.of(base)
        # Errors that are alike, or few of them large, tell less of their size.
        dof = max(dof / (misfit.tails * misfit.inflation), min(dof, _FEWEST_DOF))
        noise = max(noise, _finest(measured_mm, observed.covariance_mm2))
        prior = JointKnowledge.of(base, str(setups[0]) if known else None)
        prior = replace(prior, covariance=scale**2 * misfit.inflation * prior.covariance)

        used, row = observed.used_poses
        white = min(noise, 1.0) if misfit.inflation > 1.0 and len(used) <= MOST_POSES else noise
        excess_mm2 = (noise**2 - white**2) * float(np.trace(observed.covariance_mm2, axis1=1, axis2=2).mean()) / 3.0
        missed = np.kron(misfit.root_mm(used.q, excess_mm2), np.eye(3)).reshape(len(used), 3, -1)[
            row
        ]  # (M, 3, L) base frame

        def linearised(scanner_T_base: Array) -> tuple[Array, Array, Array]:
            """Whitened residual (3 M,), and its derivatives by x (3 M, P) and by the frame's motion (3 M, 6)."""
            predicted_mm = frames.apply(scanner_T_base, at_mm)
            residual = np.einsum("mij,mj->mi", whiten, measured_mm - predicted_mm).ravel()
            columns = (whiten @ scanner_T_base[:3, :3] @ by_x).reshape(len(residual), -1)
            motion = (whiten @ frame_motion(predicted_mm, prior.centre_mm)).reshape(len(residual), 6)
            return residual, columns, motion

        def with_missed(columns: Array, covariance: Array, scanner_T_base: Array) -> tuple[Array, Array]:
            """Derivatives and covariance of the unknowns with those of what the model misses at the new poses."""
            alike = (whiten @ scanner_T_base[:3, :3] @ missed).reshape(len(columns), -1)
            whole = np.eye(len(covariance) + alike.shape[1])
            whole[: len(covariance), : len(covariance)] = covariance
            return np.concatenate([columns, alike], axis=1), whole

        residual, columns, motion = linearised(before)
        both = np.concatenate([columns, motion], axis=1)
        spread_fixed = Spread.of(*with_missed(both, prior.covariance, before), white)
        fixed = ChangeTests.of(residual, spread_fixed, whiten @ before[:3, :3], dof, misfit.tails)

        residual, columns, motion = linearised(anew)
        n = columns.shape[1]
        spread_free = Spread.of(*with_missed(columns, prior.covariance[:n, :n], anew), white, blind=motion)
        free = ChangeTests.of(residual, spread_free, whiten @ anew[:3, :3], dof, misfit.tails)

        points, predicted_mm = observed.points, frames.apply(before, at_mm)
        colour = np.asarray(np.linalg.inv(whiten), dtype=float)
        errors = CheckErrors(
            poses=new.poses,
            pose=points.pose,
            target=tuple(map(str, points.target)),
            measured_mm=measured_mm,
            off_mm=measured_mm - predicted_mm,
            covariance=(spread_fixed if known else spread_free).coloured(colour),
            scanner_R_base=before[:3, :3],
        )
        by_frame = before[:3, :3].T @ frame_motion(predicted_mm, prior.centre_mm)
        squares_mm2 = np.sum((measured_mm - frames.apply(anew, at_mm)) ** 2, axis=1)
        sigma2_mm2 = np.trace(observed.covariance_mm2, axis1=1, axis2=2)
        return cls(
            models=change_models_of_arm(base.model, base.fit.x, observed),
            scanner=ChangeModel(SCANNER, None, "", "mm", by_frame),
            fixed=fixed,
            free=free,
            scanner_known=known,
            errors=errors,
            rmse_free_mm=float(np.sqrt(squares_mm2.mean())),
            expected_mm=float(noise * np.sqrt(sigma2_mm2.mean())),
            poses=count,
            confounded_with_scanner=() if new.robot.carries_scanner else (BASE,),
        )

    @property
    def models_with_scanner(self) -> tuple[ChangeModel, ...]:
        """Change models of the arm and of the scanner's motion."""
        return (*self.models, self.scanner)

    @property
    def p_unchanged(self) -> float:
        """Family-wise p-value of the most significant change, under the hypothesis that nothing changed."""
        if self.scanner_known:
            return self.fixed.family_wise_p_value(self.fixed.tests(self.models_with_scanner))
        return self.free.family_wise_p_value(self.free.tests(self.models))

    def scanner_moved(self, arm: list[ChangeModel]) -> Change | None:
        """Motion of the scanner, given changes of the arm; None where it is insignificant."""
        if not self.scanner_known:
            return None
        test = next(iter(self.fixed.tests((self.scanner,), given=arm)), None)
        if test is None or test.p_value > (NAMED_GIVEN_OTHERS if arm else ALARM):
            return None
        if self.fixed.noise_explains(arm, self.scanner):
            return None
        change = self.fixed.estimate(self.scanner, [*arm, self.scanner])
        moved = np.einsum("mik,k->mi", self.scanner.columns, np.array(change.vector))
        size = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        sigma = size / max(np.sqrt(test.gain), 1e-9)
        others = () if arm else confounded_with([*self.fixed.tests(self.models), test], test)
        return replace(
            change,
            size=size,
            sigma=float(sigma),
            p_value=test.p_value,
            as_well=(*self.confounded_with_scanner, *others),
        )

    def no_part_makes(self, change: Change, model: ChangeModel) -> bool:
        """Whether a change is beyond what a part can do, though the points are hardly off.

        A tool 369 mm away at points 0.1 mm off takes a scanner that moved along to hide it.
        """
        if abs(change.size) <= LARGEST_BY_UNIT[change.unit]:
            return False
        return model.moves_mm(np.array(change.vector or (change.size,))) > _HIDDEN * self.errors.rmse_mm

    def size_given(self, model: ChangeModel, arm: list[ChangeModel], *, scanner_moved: bool) -> Change:
        """Size and sigma of one change, given changes of the arm; infinite sigma where no pose shows it."""
        tests = self.free if scanner_moved or not self.scanner_known else self.fixed
        others = [other for other in arm if other.key != model.key]
        if not tests.tests((model,), given=others):
            return Change(model.what, model.joint, model.parameter, 0.0, np.inf, model.unit, 1.0, ())
        return tests.estimate(model, [*others, model])

    def explains_alone(self, model: ChangeModel) -> bool:
        """Whether a change of the arm leaves no significant motion of the scanner."""
        test = next(iter(self.fixed.tests((self.scanner,), given=[model])), None)
        return self.scanner_known and (test is None or test.p_value > ALONE)

    def change_with_scanner_fixed(self) -> list[Change]:
        """Most likely change where arm and scanner cannot be separated; [] where noise explains it."""
        models = self.models_with_scanner
        while True:
            tests = self.fixed.tests(models)
            best = most_likely(tests)
            if best is None or self.fixed.noise_explains([], best.model):
                return []
            if best.model.what == SCANNER:
                moved = self.scanner_moved([])
                return [] if moved is None else [moved]
            change = self.fixed.estimate(best.model, [best.model])
            if not self.no_part_makes(change, best.model):
                break
            models = tuple(model for model in models if model is not best.model)
        others = dict.fromkeys((*confounded_with(tests, best), SCANNER))
        return [replace(change, p_value=self.fixed.family_wise_p_value(tests), as_well=tuple(others))]


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


def _finest(measured_mm: Array, covariance_mm2: Array) -> float:
    """Least noise, over the declared noise, that rounding of the coordinates allows."""
    sigma_mm = float(np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2).mean() / 3.0))
    return _FINEST * max(float(np.abs(measured_mm).max()), 1.0) / sigma_mm
