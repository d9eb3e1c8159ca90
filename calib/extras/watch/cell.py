"""Tests for changes of a cell: new points against an earlier fit, with the scanner frame fixed or fitted anew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.extras.watch.change_models import BASE, LARGEST_BY_UNIT, SCANNER, ChangeModel
from calib.extras.watch.change_tests import (
    ALARM,
    ALONE,
    NAMED_GIVEN_OTHERS,
    ChangeTests,
    confounded_with,
    most_likely,
)
from calib.extras.watch.check_points import CheckPoints, Expectation
from calib.statistics import rms_length
from calib.validation.cell_changes import Change

_HIDDEN = 10.0  # times the RMSE, by which a change has to move the points to be refused where it is large


@dataclass(frozen=True)
class CellTests:
    """Tests for changes of a cell, with the scanner at its earlier place (`fixed`) or fitted anew (`free`)."""

    models: tuple[ChangeModel, ...]  # of the arm
    scanner: ChangeModel
    fixed: ChangeTests
    free: ChangeTests
    elsewhere_mm: float | None  # by which the points show that the scanner was set up anew; None where they do not
    scanner_known: bool  # whether the earlier fit knows the scanner's station, and it was not set up anew
    rmse_mm: float  # 3D, of the new points with the scanner where it was or, if it was set up anew, fitted to them
    likely_mm: float  # `rmse_mm` that is expected where nothing changed
    limit_mm: float  # above which `rmse_mm` is in 0.27 % of unchanged cells
    rmse_scanner_free_mm: float  # 3D, of the new points with the scanner's frame fitted anew
    expected_mm: float  # RMS, 3D, of the expected noise
    poses: int
    confounded_with_scanner: tuple[str, ...]  # the base's motion, for a scanner that stands in the world

    @classmethod
    def of(cls, base: Calibration, new: Dataset, *, scanner_moved: bool) -> CellTests:
        """Tests of new points against an earlier calibration. Raises FitError for too few poses."""
        check = CheckPoints.of(base, new)
        expected = Expectation.of(base, [check], scanner_moved=scanner_moved)
        fixed, free = expected.tests([check])
        known = expected.before_T_base is not None
        anew, earlier = check.anew_T_base, base.after.scanner_T_base.get(check.station)
        before = anew if expected.before_T_base is None else expected.before_T_base
        measured_mm, covariance_mm2 = check.measured_mm, check.observed.covariance_mm2
        colour = np.asarray(np.linalg.inv(check.whiten), dtype=float)
        likely_mm, limit_mm = (fixed if known else free).spread.coloured(colour).limits_mm
        sigma2_mm2 = np.trace(covariance_mm2, axis1=1, axis2=2)
        return cls(
            models=check.models,
            scanner=scanner_motion(check, before, expected.prior.centre_mm),
            fixed=fixed,
            free=free,
            elsewhere_mm=None if earlier is None else check.elsewhere_mm(earlier),
            scanner_known=known,
            rmse_mm=rms_length(measured_mm - frames.apply(before, check.at_mm)),
            likely_mm=likely_mm,
            limit_mm=limit_mm,
            rmse_scanner_free_mm=rms_length(measured_mm - frames.apply(anew, check.at_mm)),
            expected_mm=float(expected.noise * np.sqrt(sigma2_mm2.mean())),
            poses=check.poses,
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
        test = self.fixed.test(self.scanner, arm)
        if test is None or test.p_value > (NAMED_GIVEN_OTHERS if arm else ALARM):
            return None
        if self.fixed.noise_explains(arm, self.scanner):
            return None
        change = self.fixed.estimate(self.scanner, [*arm, self.scanner])
        moved = np.einsum("mik,k->mi", self.scanner.columns, np.array(change.vector))
        size = rms_length(moved)
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
        return model.moves_mm(np.array(change.vector or (change.size,))) > _HIDDEN * self.rmse_mm

    def size_given(self, model: ChangeModel, arm: list[ChangeModel], *, scanner_moved: bool) -> Change:
        """Size and sigma of one change, given changes of the arm; infinite sigma where no pose shows it."""
        tests = self.free if scanner_moved or not self.scanner_known else self.fixed
        others = [other for other in arm if other.key != model.key]
        if tests.test(model, others) is None:
            return Change(*model.key, np.nan, np.inf, model.unit, 1.0, ())
        return tests.estimate(model, [*others, model])

    def explains_alone(self, model: ChangeModel) -> bool:
        """Whether a change of the arm leaves no significant motion of the scanner."""
        test = self.fixed.test(self.scanner, [model])
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


def scanner_motion(check: CheckPoints, scanner_T_base: Array, centre_mm: Array) -> ChangeModel:
    """Change model of the scanner's motion by a shift (mm) and a rotation (rad) about a centre in its frame."""
    predicted_mm = frames.apply(scanner_T_base, check.at_mm)
    return ChangeModel(SCANNER, None, "", "mm", scanner_T_base[:3, :3].T @ frames.frame_motion(predicted_mm, centre_mm))
