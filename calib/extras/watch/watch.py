"""Report on changes of a cell between a calibration and check poses measured later.

The new points are predicted by the earlier fit. Their errors have the covariance of that prediction (of the earlier
fit's parameters and scanner frame) and of the noise of the earlier fit. Each possible change is tested by generalised
least squares, twice: with the scanner where it was, for *whether* anything changed, and with the scanner's frame free,
for what the arm must have caused. No change is attributed to the arm that a moved scanner explains, and none to the
cell that a sheet in another order or unit does.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.api.fits import as_calibration
from calib.calibration.result import Calibration, FittedResult, times_declared_noise
from calib.consistency.data_problem import DataProblem
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import as_dataset
from calib.errors import FitError
from calib.extras.watch.cell import CellTests
from calib.extras.watch.change_models import BASE, SCANNER, Change
from calib.extras.watch.change_tests import ALARM, Detectable
from calib.extras.watch.sheet import change_of, sheet_problem
from calib.measurement.measured_dataset import measured
from calib.presented import Presented
from calib.screening.blunders import without_blunders
from calib.statistics import axis_sigma


@dataclass(frozen=True)
class ChangeReport(Presented):
    """Report on a cell's check poses: the changes that they show, and changes that they could not detect."""

    name: str
    verdict: str  # unchanged, changed, unclear
    changes: tuple[Change, ...]
    detectable: tuple[Detectable, ...]
    rmse_mm: float  # RMS of the 3D errors of the check poses, the scanner at its earlier place unless it was moved
    limit_mm: float  # above which it is in 0.27 % of unchanged cells
    expected_mm: float  # 3D, of the expected noise
    p_unchanged: float  # p-value of the new points where nothing changed
    poses: int
    date: str = ""  # `[about] date` of the dataset
    data_problem: DataProblem | None = None  # what is wrong with the sheet, then the only change
    outside_words: str = ""  # on check poses with joints outside the ranges of the training poses
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


def watch(base: FittedResult | Dataset | str | Path, new: Dataset | str | Path) -> ChangeReport:
    """Report on the changes of a cell between an earlier calibration and check poses measured later.

    Args:
        base: the earlier calibration or diagnosis, or a dataset or its folder, which is then calibrated; poses that
            stand out in it are left out, as a diagnosis does.
        new: the check poses, a dataset or its folder. A scanner that was set up anew has a `setup` of its own there.

    Raises:
        FitError: another robot, or fewer than three poses.

    >>> import calib
    >>> earlier = calib.calibrate("sample_data/hidden_effect_a", effects="transmission_error")
    >>> calib.watch(earlier, "sample_data/hidden_effect_a").verdict
    'unchanged'
    """
    return report_of(without_blunders(as_calibration(base)), measured(as_dataset(new)))


def report_of(base: Calibration, new: Dataset) -> ChangeReport:
    """Report on the changes of a cell between a calibration without blunders and later measured points; see `watch`."""
    if new.robot.is_revolute.tolist() != base.dataset.robot.is_revolute.tolist():
        raise FitError(f"dataset {new.name}: its robot has other joints than that of {base.dataset.name}")
    if new.robot.carries_scanner != base.dataset.robot.carries_scanner:
        places = ["on the flange" if of.robot.carries_scanner else "in the room" for of in (new, base.dataset)]
        raise FitError(
            f"dataset {new.name}: its scanner is {places[0]}, that of {base.dataset.name} {places[1]}; check with the "
            "scanner where it was"
        )
    tests, trained = CellTests.of(base, [new]), base.trained
    (check,), p_unchanged, limit_mm = tests.checks, tests.p_unchanged, tests.limit_mm
    problem = sheet_problem(base, new)
    changes = tests.changes(alarmed=p_unchanged < ALARM) if problem is None else (change_of(problem),)
    is_open = any(  # arm and scanner are confounded
        SCANNER in change.as_well or (change.what == SCANNER and set(change.as_well) - {BASE}) for change in changes
    )
    is_open |= not changes and tests.rmse_mm > limit_mm
    earlier = base.after.scanner_T_base.get(check.station)
    return ChangeReport(
        name=new.name,
        verdict="unclear" if is_open else "changed" if changes else "unchanged",
        changes=changes,
        detectable=tuple(tests.free.detectable(model) for model in tests.models),
        rmse_mm=tests.rmse_mm,
        limit_mm=limit_mm,
        expected_mm=float(np.sqrt(3.0)) * tests.expected.noise * axis_sigma(check.observed.covariance_mm2),
        p_unchanged=min(p_unchanged, tests.free.p_rest([])),
        poses=check.poses,
        date=new.about.date,
        data_problem=problem,
        outside_words=trained.words(new.robot, new.poses.q, new.poses.ids),
        left_out=base.fitted_dataset.left_out,
        set_up_anew_mm=None if earlier is None else check.elsewhere_mm(earlier),
        times_noise=times_declared_noise(base),
    )
