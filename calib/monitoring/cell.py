"""The earlier fit's prediction of new points, with what is known of it."""

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
from calib.monitoring.change_tests import (
    ALARM,
    ALONE,
    NAMED_BESIDE,
    Change,
    ChangeTests,
    as_well,
    the_likeliest,
)
from calib.monitoring.check_errors import CheckErrors
from calib.monitoring.kinds import BASE, SCANNER, ChangeModel, kinds_of_the_arm
from calib.monitoring.prediction_spread import Spread

_FEWEST = 3  # check poses
_CHANCE = 1e-4  # of residuals as small as the fit's
_FINEST = 1e-9  # share of the largest coordinate: no number here is known better, however little a fit left


@dataclass(frozen=True)
class Cell:
    """The earlier fit's prediction of the new points, with the scanner where it was and with its place free."""

    kinds: tuple[ChangeModel, ...]
    kinds_with_scanner: tuple[ChangeModel, ...]
    fixed: ChangeTests
    free: ChangeTests
    scanner_known: bool
    scanner: ChangeModel
    errors: CheckErrors
    rmse_free_mm: float
    expected_mm: float
    poses: int
    alike: tuple[str, ...]  # what looks like a motion of the scanner: the base's, where it stands in the room

    @classmethod
    def of(cls, base: Calibration, new: Dataset, *, scanner_moved: bool) -> Cell:
        """Raises FitError for too few poses."""
        poses = replace(new, poses=new.poses.measured_later())
        observed = Observations.of(poses, np.ones(len(new.poses), dtype=bool))
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
        measured = observed.points.xyz_mm
        anew = fit_scanner_frame(at_mm, measured, observed.covariance_mm2)
        before = base.after.scanner_T_base[str(setups[0])] if known else anew
        noise, freedom, scale = _noise(base)
        noise = max(noise, _finest(measured, observed.covariance_mm2))
        prior = JointKnowledge.of(base, str(setups[0]) if known else None)
        prior = replace(prior, covariance=scale**2 * prior.covariance)
        kinds = kinds_of_the_arm(base.model, base.fit.x, observed)

        colour = np.asarray(np.linalg.inv(whiten), dtype=float)

        def placed(scanner_T_base: Array) -> tuple[Array, Array, Array]:
            """Residual (3 M,), derivatives by x (3 M, P) and by the frame's motion (3 M, 6), whitened."""
            seen = frames.apply(scanner_T_base, at_mm)
            residual = np.einsum("mij,mj->mi", whiten, measured - seen).ravel()
            columns = (whiten @ scanner_T_base[:3, :3] @ by_x).reshape(len(residual), -1)
            motion = (whiten @ frame_motion(seen, prior.centre_mm)).reshape(len(residual), 6)
            return residual, columns, motion

        residual, columns, motion = placed(before)
        spread = Spread.of(np.concatenate([columns, motion], axis=1), prior.covariance, noise)
        fixed = ChangeTests.of(residual, spread, whiten @ before[:3, :3], freedom)
        of_errors = spread

        residual, columns, motion = placed(anew)
        n = columns.shape[1]
        spread = Spread.of(columns, prior.covariance[:n, :n], noise, blind=motion)
        free = ChangeTests.of(residual, spread, whiten @ anew[:3, :3], freedom)
        left = np.sum((measured - frames.apply(anew, at_mm)) ** 2, axis=1)
        if not known:
            of_errors = spread
        points = observed.points
        errors = CheckErrors(
            new.poses, points.pose, tuple(map(str, points.target)), measured, measured - frames.apply(before, at_mm),
            of_errors.coloured(colour), before[:3, :3],
        )  # fmt: skip

        by_frame = before[:3, :3].T @ frame_motion(frames.apply(before, at_mm), prior.centre_mm)
        scanner = ChangeModel(SCANNER, None, "", "mm", by_frame)
        sigma2 = np.trace(observed.covariance_mm2, axis1=1, axis2=2)
        return cls(
            kinds, (*kinds, scanner), fixed, free, known, scanner, errors, float(np.sqrt(left.mean())),
            float(noise * np.sqrt(sigma2.mean())), count, () if new.robot.carries_scanner else (BASE,),
        )  # fmt: skip

    @property
    def p_unchanged(self) -> float:
        """p-value of the most striking kind of change where nothing changed."""
        if self.scanner_known:
            return self.fixed.chance(self.fixed.tests(self.kinds_with_scanner))
        return self.free.chance(self.free.tests(self.kinds))

    def scanner_moved(self, arm: list[ChangeModel]) -> Change | None:
        """The scanner's motion beside these changes of the arm, where it shows; the base's would look the same."""
        if not self.scanner_known:
            return None
        test = next(iter(self.fixed.tests((self.scanner,), given=arm)), None)
        if test is None or test.p_value > (NAMED_BESIDE if arm else ALARM):
            return None
        if self.fixed.noise_explains(arm, self.scanner):
            return None
        found = self.fixed.found(self.scanner, [*arm, self.scanner])
        shift, turn = np.array(found.vector[:3]), np.array(found.vector[3:])
        moved = np.einsum("mik,k->mi", self.scanner.columns, np.concatenate([shift, turn]))
        size = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        sigma = size / max(np.sqrt(test.gain), 1e-9)
        instead = () if arm else as_well([*self.fixed.tests(self.kinds), test], test)
        return replace(found, size=size, sigma=float(sigma), p_value=test.p_value, as_well=(*self.alike, *instead))

    def beside(self, kind: ChangeModel, arm: list[ChangeModel], *, scanner_moved: bool) -> Change:
        """Size and sigma of a change beside those that were found; the sigma is infinite where nothing shows it."""
        view = self.free if scanner_moved or not self.scanner_known else self.fixed
        others = [other for other in arm if other.key != kind.key]
        if not view.tests((kind,), given=others):
            return Change(kind.what, kind.joint, kind.parameter, 0.0, np.inf, kind.unit, 1.0, ())
        return view.found(kind, [*others, kind])

    def explains_alone(self, kind: ChangeModel) -> bool:
        """Whether a change of the arm leaves nothing to a scanner that stands where it stood."""
        beside = next(iter(self.fixed.tests((self.scanner,), given=[kind])), None)
        return self.scanner_known and (beside is None or beside.p_value > ALONE)

    def with_the_scanner_where_it_was(self) -> list[Change]:
        """The change that explains best what a moved scanner may explain as well: nobody knows then which it was."""
        tests = self.fixed.tests(self.kinds_with_scanner)
        best = the_likeliest(tests)
        if best is None or self.fixed.noise_explains([], best.kind):
            return []
        if best.kind.what == SCANNER:
            moved = self.scanner_moved([])
            return [] if moved is None else [moved]
        found = self.fixed.found(best.kind, [best.kind])
        others = dict.fromkeys((*as_well(tests, best), SCANNER))
        return [replace(found, p_value=self.fixed.chance(tests), as_well=tuple(others))]


def _noise(base: Calibration) -> tuple[float, float, float]:
    """The noise over the declared one, its degrees of freedom, and its ratio to the one that the fit counted with.

    Where the fit left less than was declared by no more than chance does, what was declared stands: a fit whose
    residuals happened to be small would take every later noise for a change.
    """
    noise, freedom = base.fit.reduced_chi, base.fit.degrees_of_freedom
    if not np.isfinite(noise):
        return 1.0, np.inf, 1.0
    by_chance = noise < 1.0 and 1.0 - chi2_sf(freedom * noise**2, freedom) > _CHANCE
    return (1.0, freedom, 1.0 / noise) if by_chance else (noise, freedom, 1.0)


def _finest(measured_mm: Array, covariance_mm2: Array) -> float:
    """The least noise over the declared one that can be counted with: exact data leave nothing but rounding."""
    sigma_mm = float(np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2).mean() / 3.0))
    return _FINEST * max(float(np.abs(measured_mm).max()), 1.0) / sigma_mm
