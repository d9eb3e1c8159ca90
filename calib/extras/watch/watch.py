"""Report on changes of a cell between a calibration and check poses measured later.

The new points are predicted by the earlier fit. Their errors have the covariance of that prediction (of the earlier
fit's parameters and scanner frame) and of the noise of the earlier fit. Each possible change is tested by generalised
least squares, twice: with the scanner where it was, for *whether* anything changed, and with the scanner's frame free,
for what the arm must have caused. No change is attributed to the arm that a moved scanner explains, and none to the
cell that a sheet in another order or unit does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.api.fits import as_calibration
from calib.calibration.result import Calibration, FittedResult, times_declared_noise
from calib.consistency.data_problem import DataProblem
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.errors import FitError
from calib.extras.watch.cell import CellTests
from calib.extras.watch.change_models import BASE, JIG, JOINT_ZERO, NOISE, SCANNER, TOOL, ChangeModel
from calib.extras.watch.change_tests import (
    ALARM,
    NAMED,
    NAMED_GIVEN_OTHERS,
    NOISIER,
    Detectable,
    confounded_with,
    most_likely,
)
from calib.extras.watch.sheet import change_of, sheet_problem
from calib.measurement.measured_dataset import measured
from calib.presented import Presented
from calib.screening.blunders import without_blunders
from calib.validation.cell_changes import CellChanges, Change

MAX_ARM_CHANGES = 3  # most changes of the arm that are named


@dataclass(frozen=True)
class ChangeReport(Presented):
    """Report on a cell's check poses: the changes that they show, and changes that they could not detect."""

    name: str
    verdict: str  # unchanged, changed, unclear
    changes: tuple[Change, ...]
    detectable: tuple[Detectable, ...]
    rmse_mm: float  # RMS of the 3D errors of the check poses, the scanner at its earlier place unless it was moved
    likely_mm: float  # of it where nothing changed, by noise and the earlier fit's uncertainty
    limit_mm: float  # above which it is in 0.27 % of unchanged cells
    usual: tuple[Change, ...]  # each joint's zero and the tool given `changes`, whether it changed or not
    rmse_scanner_free_mm: float  # 3D, the scanner's frame fitted anew
    expected_mm: float  # 3D, of the expected noise
    p_unchanged: float  # p-value of the new points where nothing changed
    poses: int
    date: str = ""  # `[about] date` of the dataset
    data_problem: DataProblem | None = None  # what is wrong with the sheet, then the only change
    outside: tuple[str, ...] = ()  # check poses with joints outside the ranges of the training poses
    outside_words: str = ""
    left_out: tuple[str, ...] = ()  # poses that the earlier fit does without, as asked or as they stand out
    set_up_anew_mm: float | None = None  # how far the points are from where the scanner's earlier place has them
    times_noise: float | None = None  # residual of the earlier fit over the declared noise; None where none is declared

    @property
    def unseen(self) -> tuple[Detectable, ...]:
        """Changes that these poses detect only if points move by over three times the noise, or not at all."""
        return tuple(d for d in self.detectable if d.moves_mm is None or d.moves_mm > 3.0 * self.expected_mm)

    def _brief(self) -> str:
        errors = f"RMSE {self.rmse_mm:.3g} mm, {self.expected_mm:.3g} mm by noise"
        return f"{self.name}: {self.verdict}, {self.poses} poses, {errors}"


def watch(
    base: FittedResult | Dataset | str | Path, new: Dataset | str | Path, *, scanner_moved: bool = False
) -> ChangeReport:
    """Report on the changes of a cell between an earlier calibration and check poses measured later.

    Args:
        base: the earlier calibration or diagnosis, or a dataset or its folder, which is then calibrated; poses that
            stand out in it are left out, as a diagnosis does.
        new: the check poses, a dataset or its folder.
        scanner_moved: whether the scanner was set up anew, which is then no change; else it stands where it stood.

    Raises:
        FitError: another robot, or fewer than three poses.

    >>> import calib
    >>> earlier = calib.calibrate("sample_data/hidden_effect_a", effects="transmission_error")
    >>> calib.watch(earlier, "sample_data/hidden_effect_a").verdict
    'unchanged'
    """
    return report_of(without_blunders(as_calibration(base)), measured(as_dataset(new)), scanner_moved=scanner_moved)


def report_of(base: Calibration, new: Dataset, *, scanner_moved: bool) -> ChangeReport:
    """Report on the changes of a cell between a calibration without blunders and later measured points; see `watch`."""
    if new.robot.is_revolute.tolist() != base.dataset.robot.is_revolute.tolist():
        raise FitError(f"dataset {new.name}: its robot has other joints than that of {base.dataset.name}")
    if new.robot.carries_scanner != base.dataset.robot.carries_scanner:
        places = ["on the flange" if of.robot.carries_scanner else "in the room" for of in (new, base.dataset)]
        raise FitError(
            f"dataset {new.name}: its scanner is {places[0]}, that of {base.dataset.name} {places[1]}; check with the "
            "scanner where it was"
        )
    tests, trained = CellTests.of(base, new, scanner_moved=scanner_moved), base.trained
    p_unchanged = tests.p_unchanged
    problem = sheet_problem(base, new)
    changes = _changes(tests, alarmed=p_unchanged < ALARM) if problem is None else (change_of(problem),)
    beyond = tests.rmse_mm > tests.limit_mm
    open_cause = _arm_or_scanner(changes) if changes else beyond
    verdict = "unclear" if open_cause else "changed" if changes else "unchanged"
    return ChangeReport(
        name=new.name,
        verdict=verdict,
        changes=changes,
        detectable=tuple(tests.free.detectable(model) for model in tests.models),
        rmse_mm=tests.rmse_mm,
        likely_mm=tests.likely_mm,
        limit_mm=tests.limit_mm,
        usual=_usual(tests, changes),
        rmse_scanner_free_mm=tests.rmse_scanner_free_mm,
        expected_mm=tests.expected_mm,
        p_unchanged=min(p_unchanged, tests.free.p_noise),
        poses=tests.poses,
        date=new.about.date,
        data_problem=problem,
        outside=tuple(new.poses.ids[i] for i in np.flatnonzero(trained.outside(new.robot, new.poses.q))),
        outside_words=trained.words(new.robot, new.poses.q, new.poses.ids),
        left_out=base.fitted_dataset.left_out,
        set_up_anew_mm=None if scanner_moved else tests.elsewhere_mm,
        times_noise=times_declared_noise(base),
    )


def _usual(tests: CellTests, changes: tuple[Change, ...]) -> tuple[Change, ...]:
    """Size of the change of each joint's zero and of the tool or jig, given the changes found."""
    named = {(c.what, c.joint, c.parameter) for c in changes if SCANNER not in c.as_well}
    arm = [model for model in tests.models if model.key in named]
    moved = any(c.what == SCANNER for c in changes)
    usual = [model for model in tests.models if model.what in (JOINT_ZERO, TOOL, JIG)]
    return tuple(tests.size_given(model, arm, scanner_moved=moved) for model in usual)


def _arm_or_scanner(changes: tuple[Change, ...]) -> bool:
    """Whether a change of the arm and a motion of the scanner are confounded."""
    return any(change.what == SCANNER and set(change.as_well) - {BASE} for change in changes) or any(
        SCANNER in change.as_well for change in changes
    )


def _changes(tests: CellTests, *, alarmed: bool) -> tuple[Change, ...]:
    """Significant changes of a cell: first of the arm, then the scanner's motion, then the noise.

    alarmed: whether anything changed; else only the noise can have.
    """
    changes = _of_arm_and_scanner(tests) if alarmed else []
    models = [model for model in tests.models if any(model.key == (c.what, c.joint, c.parameter) for c in changes)]
    p_noise = tests.free.p_rest(models)
    if p_noise < NOISIER:
        ratio = tests.free.noise_ratio(models)
        sigma = ratio / np.sqrt(2.0 * tests.free.dof(models))
        changes.append(Change(NOISE, None, "", ratio, float(sigma), "times", p_noise, ()))
    return tuple(changes)


def _of_arm_and_scanner(tests: CellTests) -> list[Change]:
    """Significant changes of the arm, added one by one, and the scanner's motion given these changes."""
    models = tests.models
    arm: list[ChangeModel] = []
    p_values: list[float] = []
    confounded: list[tuple[str, ...]] = []
    while len(arm) < MAX_ARM_CHANGES:
        of_each = tests.free.tests(models, given=arm)
        best = most_likely(of_each)
        if best is None:
            break
        if tests.no_part_makes(tests.free.estimate(best.model, [*arm, best.model]), best.model):
            models = tuple(model for model in models if model is not best.model)
            continue
        p_value = tests.free.family_wise_p_value(of_each)
        limit = NAMED if not arm and tests.explains_alone(best.model) else NAMED_GIVEN_OTHERS
        if not tests.scanner_known and not arm:
            limit = ALARM
        if p_value > limit or tests.free.noise_explains(arm, best.model):
            break
        arm.append(best.model)
        p_values.append(p_value)
        confounded.append(confounded_with(of_each, best))
    if not arm:
        return tests.change_with_scanner_fixed() if tests.scanner_known else []
    moved = tests.scanner_moved(arm)
    fitted = tests.free if moved is not None or not tests.scanner_known else tests.fixed
    changes = [
        replace(fitted.estimate(model, arm), p_value=p_value, as_well=others)
        for model, p_value, others in zip(arm, p_values, confounded, strict=True)
    ]
    return changes if moved is None else [*changes, moved]


def changes_since(calibration: Calibration, later: Dataset) -> CellChanges:
    """Changes of a cell between a calibration and a later dataset, as other rooms take them."""
    report = report_of(without_blunders(calibration), measured(later), scanner_moved=False)
    problem = "" if report.data_problem is None else report.data_problem.warning
    return CellChanges(report.verdict, report.changes, report.rmse_mm, report.expected_mm, report.poses, problem)
