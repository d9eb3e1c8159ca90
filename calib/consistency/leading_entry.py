"""Entry of the robot's table that alone explains most of the error of the arm as delivered.

"The arm is a centimetre off everywhere" is mostly one thing: a joint whose zero was set wrong, one link of another
length. A fit of all entries removes the error and spreads it over all that move the tool alike, so that nobody sees
what it was. Here each entry is fitted alone, all others being as in robot.toml, with the instrument's frame free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.calibration.result import Calibration
from calib.consistency.agreement import (
    Sample,
    main_target,
    misfit_columns,
    misfit_mm,
    training_sample,
    with_entries_fitted,
)
from calib.kinematics.robot import PARAMETER_KINDS, TOOL_POINT
from calib.kinematics.tool_point import ending_at_tool_point

MOST_LEFT = 0.5  # of the error, that an entry which explains most of it leaves: three quarters of its square
_AS_GOOD = 1.25  # times what the best entry leaves, up to which another may be it as well
_MOST_RIVALS = 2  # more, and nothing is said
_TIMES_LEFT = 10.0  # the error as delivered over what the whole fit leaves, below which there is no such question
_LEAST = {"mm": 0.5, "rad": float(np.radians(0.1))}  # of an entry worth a word


@dataclass(frozen=True)
class LeadingEntry:
    """Entry of the table which, corrected alone, takes most of the delivered arm's error away."""

    parameter: str  # "theta2"
    off: float  # what the arm has more than robot.toml, fitted alone
    unit: str  # "mm" or "rad"
    delivered_mm: float  # 3D RMSE of the training points with robot.toml as it is
    corrected_mm: float  # the same with this entry corrected
    rivals: tuple[str, ...] = ()  # entries that would explain it as well

    @property
    def share(self) -> float:
        """Share of the squared error that it takes away."""
        return 1.0 - (self.corrected_mm / self.delivered_mm) ** 2


def leading_entry(calibration: Calibration) -> LeadingEntry | None:
    """Entry that alone explains most of the error as delivered; None where there is none, or more than three may be it.

    Not asked where the tool point was found far off, which is said in its place, nor of lengths, nor where the arm
    carries the scanner.
    """
    dataset, left = calibration.dataset, calibration.after.train
    if calibration.tool_shift is not None or left is None or dataset.points is None:
        return None
    sample = None if dataset.points.lengths is not None else training_sample(calibration.fitted_dataset)
    if sample is None or not sample.is_enough:
        return None
    if main_target(dataset.points) != TOOL_POINT:
        return None
    delivered_mm = misfit_mm(ending_at_tool_point(dataset.robot), sample, tool_is_known=True)
    if delivered_mm < _TIMES_LEFT * left.rmse_mm:
        return None
    found = _tried(calibration, sample, delivered_mm)
    if not found:
        return None
    best, *others = found
    as_good = [one for one in others if one.corrected_mm < _AS_GOOD * best.corrected_mm]
    if best.corrected_mm > MOST_LEFT * delivered_mm or len(as_good) > _MOST_RIVALS or abs(best.off) < _LEAST[best.unit]:
        return None
    rivals = tuple(one.parameter for one in as_good)
    return LeadingEntry(best.parameter, best.off, best.unit, delivered_mm, best.corrected_mm, rivals)


def _tried(calibration: Calibration, sample: Sample, delivered_mm: float) -> list[LeadingEntry]:
    """Entries that are likely by the derivatives, each fitted alone, the best first."""
    own, robot = calibration.dataset.robot.own_tool_point, ending_at_tool_point(calibration.dataset.robot)
    entries = range(len(robot.parameter_names) - (0 if own is None else len(PARAMETER_KINDS)))
    off, columns = misfit_columns(robot, sample, entries, tool_is_known=True)
    squares = np.sum(columns**2, axis=0)
    # In an entry's own unit: mm of the tool by a tenth of a millimetre or a hundredth of a degree, else it is not seen.
    gain = np.where(squares > 1e-9 * squares.max(), (columns.T @ off) ** 2 / np.maximum(squares, 1e-300), 0.0)
    likely = [k for k in np.argsort(-gain) if gain[k] > (1.0 - 1.5 * MOST_LEFT) * float(off @ off)]
    out = []
    for k in likely[: 2 * _MOST_RIVALS + 2]:
        fitted = with_entries_fitted(robot, sample, [int(k)], tool_is_known=True)
        corrected_mm = misfit_mm(fitted, sample, tool_is_known=True)
        by = float((fitted.table - robot.table).ravel()[k])
        out.append(LeadingEntry(robot.parameter_names[k], by, robot.parameter_units[k], delivered_mm, corrected_mm))
    return sorted(out, key=lambda one: one.corrected_mm)
