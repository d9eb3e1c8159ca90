"""Changes of a cell: new points against an earlier fit, with the scanner frame fixed or fitted anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array_types import Array
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.extras.watch.change_models import (
    BASE,
    JIG,
    LARGEST_BY_UNIT,
    NOISE,
    SCANNER,
    Change,
    ChangeModel,
    over_time,
)
from calib.extras.watch.change_tests import (
    ALARM,
    ALONE,
    NAMED,
    NAMED_GIVEN_OTHERS,
    NOISIER,
    ChangeTests,
    confounded_with,
    family_wise_p_value,
    most_likely,
)
from calib.extras.watch.check_points import CheckPoints, Expectation
from calib.statistics import rms_length

MAX_ARM_CHANGES = 3  # most changes of the arm that are named
_HIDDEN = 10.0  # times the RMSE, by which a change has to move the points to be refused where it is large


@dataclass(frozen=True)
class CellTests:
    """Tests for changes of a cell by checks, with the scanner at its earlier place (`fixed`) or fitted anew (`free`).

    What changed by a single check is told here, by several over time in `calib.extras.watch.series`.
    """

    checks: tuple[CheckPoints, ...]
    expected: Expectation
    models: tuple[ChangeModel, ...]  # of the arm
    scanner: tuple[ChangeModel, ...]  # of its motion; () where the earlier fit does not know its place
    fixed: ChangeTests
    free: ChangeTests

    @classmethod
    def of(cls, base: Calibration, new: Sequence[Dataset], times: Array | None = None) -> CellTests:
        """Tests of new points against an earlier calibration, at times (S,) where several checks are tested together.

        Raises FitError for too few poses.
        """
        checks = tuple(CheckPoints.of(base, each) for each in new)
        expected = Expectation.of(base, checks)
        before, centre_mm = expected.before_T_base, expected.prior.centre_mm
        of_each = (
            [check.models for check in checks],
            [() if before is None else (check.scanner_motion(before, centre_mm),) for check in checks],
        )
        row = np.repeat(np.arange(len(checks)), [len(check.at_mm) for check in checks])
        models, scanner = (tuple(each[0] if times is None else over_time(each, times, row)) for each in of_each)
        return cls(checks, expected, models, scanner, *expected.tests(checks))

    @property
    def scanner_known(self) -> bool:
        """Whether the earlier fit knows the scanner's station, and it was not set up anew."""
        return self.expected.before_T_base is not None

    @property
    def rmse_mm(self) -> float:
        """RMS of the 3D errors with the scanner where it was or, if it was set up anew, fitted to the points."""
        (check,), before = self.checks, self.expected.before_T_base
        return rms_length(check.errors_mm(check.anew_T_base if before is None else before))

    @property
    def limit_mm(self) -> float:
        """Limit of `rmse_mm` in 99.73 % of unchanged cells."""
        return (self.fixed if self.scanner_known else self.free).spread.limit_mm(self.checks[0].colour)

    @property
    def p_unchanged(self) -> float:
        """Family-wise p-value of the most significant change, under the hypothesis that nothing changed."""
        tests = self.fixed if self.scanner_known else self.free
        return family_wise_p_value(tests.tests((*self.models, *self.scanner)))

    def changes(self, *, alarmed: bool) -> tuple[Change, ...]:
        """Significant changes of a cell: first of the arm, then the scanner's motion, then the noise.

        alarmed: whether anything changed; else only the noise can have.
        """
        changes = self._of_arm_and_scanner() if alarmed else []
        models = [model for model in self.models if any(model.key == (c.what, c.joint, c.parameter) for c in changes)]
        p_noise = self.free.p_rest(models)
        if p_noise < NOISIER:
            ratio = self.free.noise_ratio(models)
            sigma = ratio / float(np.sqrt(2.0 * self.free.dof(models)))
            changes.append(Change(NOISE, None, "", ratio, sigma, "times", p_noise, ()))
        return tuple(changes)

    def _of_arm_and_scanner(self) -> list[Change]:
        """Significant changes of the arm, added one by one, and the scanner's motion given these changes."""
        models, found = self.models, dict[ChangeModel, tuple[float, tuple[str, ...]]]()
        while len(found) < MAX_ARM_CHANGES:
            arm = list(found)
            of_each = self.free.tests(models, given=arm)
            best = most_likely(of_each)
            if best is None:
                break
            if self.no_part_makes(self.free.estimate(best.model, [*arm, best.model]), best.model):
                models = tuple(model for model in models if model is not best.model)
                continue
            p_value = family_wise_p_value(of_each)
            limit = NAMED if not arm and self._explains_alone(best.model) else NAMED_GIVEN_OTHERS
            if not self.scanner_known and not arm:
                limit = ALARM
            if p_value > limit or self.free.noise_explains(arm, best.model):
                break
            found[best.model] = p_value, confounded_with(of_each, best)
        if not found:
            return self._with_scanner_fixed() if self.scanner_known else []
        arm = list(found)
        moved = self._scanner_moved(arm)
        fitted = self.free if moved is not None or not self.scanner_known else self.fixed
        changes = [
            replace(fitted.estimate(model, arm), p_value=p_value, as_well=others)
            for model, (p_value, others) in found.items()
        ]
        return changes if moved is None else [*changes, moved]

    def _scanner_moved(self, arm: list[ChangeModel]) -> Change | None:
        """Motion of the scanner, given changes of the arm; None where it is insignificant."""
        test = next(iter(self.fixed.tests(self.scanner, arm)), None)
        if test is None or test.p_value > (NAMED_GIVEN_OTHERS if arm else ALARM):
            return None
        if self.fixed.noise_explains(arm, test.model):
            return None
        change = self.fixed.estimate(test.model, [*arm, test.model])
        size = test.model.moves_mm(np.array(change.vector))
        others = () if arm else confounded_with([*self.fixed.tests(self.models), test], test)
        is_carried = any(model.what == JIG for model in self.models)
        of_base = () if is_carried else (BASE,)  # for a scanner that stands in the world
        sigma = size / max(float(np.sqrt(test.gain)), 1e-9)
        return replace(change, size=size, sigma=sigma, p_value=test.p_value, as_well=(*of_base, *others))

    def no_part_makes(self, change: Change, model: ChangeModel) -> bool:
        """Whether a change is beyond what a part can do, though the points are hardly off.

        A tool 369 mm away at points 0.1 mm off takes a scanner that moved along to hide it.
        """
        moved_mm = model.moves_mm(np.array(change.vector or (change.size,)))
        return abs(change.size) > LARGEST_BY_UNIT[change.unit] and moved_mm > _HIDDEN * self.rmse_mm

    def _explains_alone(self, model: ChangeModel) -> bool:
        """Whether a change of the arm leaves no significant motion of the scanner."""
        return self.scanner_known and all(t.p_value > ALONE for t in self.fixed.tests(self.scanner, [model]))

    def _with_scanner_fixed(self) -> list[Change]:
        """Most likely change where arm and scanner cannot be separated; [] where noise explains it."""
        models = [*self.models, *self.scanner]
        while True:
            tests = self.fixed.tests(models)
            best = most_likely(tests)
            if best is None or self.fixed.noise_explains([], best.model):
                return []
            if best.model.what == SCANNER:
                moved = self._scanner_moved([])
                return [] if moved is None else [moved]
            change = self.fixed.estimate(best.model, [best.model])
            if not self.no_part_makes(change, best.model):
                break
            models.remove(best.model)
        others = dict.fromkeys((*confounded_with(tests, best), SCANNER))
        return [replace(change, p_value=family_wise_p_value(tests), as_well=tuple(others))]
