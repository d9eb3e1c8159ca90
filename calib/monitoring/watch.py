"""What changed between a calibration and a few check poses measured later, and what nobody could have seen.

The new points are predicted by the earlier fit. What they are off by has the covariance of that prediction (the earlier
fit's parameters and scanner frame are known only so well) and of the noise that the earlier fit left. Each kind of
change is held against it by generalised least squares, twice: with the scanner where it was, which tells *whether*
anything changed, and with the scanner's place free, which tells what of it the arm must answer for. Nothing is blamed
on the arm that a moved scanner explains, and nothing on the cell that a sheet in another order or unit does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.calibration.calibrate import as_calibration
from calib.calibration.result import FittedResult
from calib.consistency.data_problem import DataProblem
from calib.dataset.dataset import Dataset
from calib.errors import FitError
from calib.measurement.measured_dataset import measured
from calib.monitoring.cell import Cell
from calib.monitoring.change_tests import (
    ALARM,
    NAMED,
    NAMED_BESIDE,
    NOISIER,
    Change,
    Detectable,
    as_well,
    the_likeliest,
)
from calib.monitoring.check_errors import CheckErrors
from calib.monitoring.kinds import (
    BASE,
    JIG,
    JOINT_ZERO,
    NOISE,
    SCANNER,
    TOOL,
    ChangeModel,
)
from calib.monitoring.sheet import found_of, sheet_problem
from calib.presented import Presented

MOST = 3  # changes of the arm that are told


@dataclass(frozen=True)
class ChangeReport(Presented):
    """What a set of check poses says of a cell."""

    name: str
    verdict: str  # unchanged, changed, unclear
    changes: tuple[Change, ...]
    detectable: tuple[Detectable, ...]
    errors: CheckErrors
    usual: tuple[Change, ...]  # each joint's zero and the tool, as if that alone had changed, whether it did or not
    rmse_free_mm: float  # 3D, the scanner's place fitted anew
    expected_mm: float  # 3D, of what the earlier fit and its noise leave
    p_unchanged: float
    poses: int
    when: str = ""  # the date that the dataset tells
    data_problem: DataProblem | None = None  # what is wrong with the sheet; then nothing is said of the cell
    outside: tuple[str, ...] = ()  # check poses whose joints leave the ranges that were trained
    outside_words: str = ""

    @property
    def rmse_mm(self) -> float:
        """3D, the scanner where it was."""
        return self.errors.rmse_mm

    @property
    def unseen(self) -> tuple[Detectable, ...]:
        """Kinds that these poses show only where they move the points by more than three times the noise, or never."""
        return tuple(d for d in self.detectable if d.moves_mm is None or d.moves_mm > 3.0 * self.expected_mm)

    def _brief(self) -> str:
        errors = f"RMSE {self.rmse_mm:.3g} mm, {self.expected_mm:.3g} mm by noise"
        return f"{self.name}: {self.verdict}, {self.poses} poses, {errors}"


def watch(
    base: FittedResult | Dataset | str | Path, new: Dataset | str | Path, *, scanner_moved: bool = False
) -> ChangeReport:
    """Changes of a cell between an earlier calibration and new measurements of some check poses.

    Args:
        base: the earlier calibration or diagnosis, or a dataset or its folder, which is then calibrated.
        new: the check poses, a dataset or its folder.
        scanner_moved: whether the scanner was put up anew, which is then no change; else it stands where it stood.

    Raises:
        FitError: another robot, or fewer than three poses.

    >>> import calib
    >>> earlier = calib.calibrate("sample_data/hidden_effect_a", effects="transmission_error")
    >>> calib.watch(earlier, "sample_data/hidden_effect_a").verdict
    'unchanged'
    """
    base, new = as_calibration(base), measured(new)
    if new.robot.is_revolute.tolist() != base.dataset.robot.is_revolute.tolist():
        raise FitError(f"dataset {new.name}: its robot has other joints than that of {base.dataset.name}")
    if new.robot.carries_scanner != base.dataset.robot.carries_scanner:
        places = ["on the flange" if of.robot.carries_scanner else "in the room" for of in (new, base.dataset)]
        raise FitError(
            f"dataset {new.name}: its scanner is {places[0]}, that of {base.dataset.name} {places[1]}; check with the "
            "scanner where it was"
        )
    cell, trained = Cell.of(base, new, scanner_moved=scanner_moved), base.trained
    p_unchanged = cell.p_unchanged
    problem = sheet_problem(base, new)
    changes = _changes(cell, alarmed=p_unchanged < ALARM) if problem is None else (found_of(problem),)
    verdict = "unchanged" if not changes else "unclear" if _mixed(changes) else "changed"
    return ChangeReport(
        name=new.name,
        verdict=verdict,
        changes=changes,
        detectable=tuple(cell.free.detectable(kind) for kind in cell.kinds),
        errors=cell.errors,
        usual=_usual(cell, changes),
        rmse_free_mm=cell.rmse_free_mm,
        expected_mm=cell.expected_mm,
        p_unchanged=min(p_unchanged, cell.free.p_noise),
        poses=cell.poses,
        when=new.about.date,
        data_problem=problem,
        outside=tuple(new.poses.ids[i] for i in np.flatnonzero(trained.outside(new.robot, new.poses.q))),
        outside_words=trained.words(new.robot, new.poses.q, new.poses.ids),
    )


def _usual(cell: Cell, changes: tuple[Change, ...]) -> tuple[Change, ...]:
    named = {(c.what, c.joint, c.parameter) for c in changes if SCANNER not in c.as_well}
    arm = [kind for kind in cell.kinds if kind.key in named]
    moved = any(c.what == SCANNER for c in changes)
    usual = [kind for kind in cell.kinds if kind.what in (JOINT_ZERO, TOOL, JIG)]
    return tuple(cell.beside(kind, arm, scanner_moved=moved) for kind in usual)


def _mixed(changes: tuple[Change, ...]) -> bool:
    """Whether the arm and the scanner explain a change equally well: nobody knows then what to mend."""
    return any(change.what == SCANNER and set(change.as_well) - {BASE} for change in changes) or any(
        SCANNER in change.as_well for change in changes
    )


def _changes(cell: Cell, *, alarmed: bool) -> tuple[Change, ...]:
    """What the arm must answer for, with the scanner's place free; then whether the scanner moved, and the noise.

    alarmed: whether anything changed; else only the noise can have.
    """
    found = [] if not alarmed else _of_arm_and_scanner(cell)
    kinds = [kind for kind in cell.kinds if any(kind.key == (f.what, f.joint, f.parameter) for f in found)]
    p_noise = cell.free.p_rest(kinds)
    if p_noise < NOISIER:
        ratio = cell.free.noise_ratio(kinds)
        sigma = ratio / np.sqrt(2.0 * cell.free.freedom(kinds))
        found.append(Change(NOISE, None, "", ratio, float(sigma), "times", p_noise, ()))
    return tuple(found)


def _of_arm_and_scanner(cell: Cell) -> list[Change]:
    arm: list[ChangeModel] = []
    said: list[tuple[float, tuple[str, ...]]] = []
    while len(arm) < MOST:
        tests = cell.free.tests(cell.kinds, given=arm)
        best = the_likeliest(tests)
        if best is None:
            break
        p = cell.free.chance(tests)
        enough = NAMED if not arm and cell.explains_alone(best.kind) else NAMED_BESIDE
        if not cell.scanner_known and not arm:
            enough = ALARM
        if p > enough or cell.free.noise_explains(arm, best.kind):
            break
        arm.append(best.kind)
        said.append((p, as_well(tests, best)))
    if not arm:
        return cell.with_the_scanner_where_it_was() if cell.scanner_known else []
    moved = cell.scanner_moved(arm)
    view = cell.free if moved is not None or not cell.scanner_known else cell.fixed
    found = [
        replace(view.found(kind, arm), p_value=p, as_well=others) for kind, (p, others) in zip(arm, said, strict=True)
    ]
    return found if moved is None else [*found, moved]
