"""Mistakes in a table of check poses (signs, order, units, rows), found by the earlier fit's predictions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from calib.calibration.result import Calibration
from calib.consistency.agreement import points_of_poses, training_sample
from calib.consistency.data_problem import DataProblem, is_beyond_effects
from calib.consistency.hypotheses import (
    ROW_ORDER,
    DataHypothesis,
    column_names,
    of_matching,
    of_reading,
    of_shifts,
    of_units,
    simplest_of,
)
from calib.consistency.joint_reading import simple_readings
from calib.consistency.row_matching import matched_rows
from calib.dataset.dataset import Dataset
from calib.extras.watch.change_models import Change
from calib.extras.watch.check_points import CheckPoints
from calib.statistics import rms_length

POSE_ORDER = "pose_order"
_FALLS_TO = 0.1  # share of the error that may remain: no change of an arm looks like another sheet
_AS_GOOD = 2.0  # times the least error, up to which a simpler hypothesis is as good
_FEWEST = 4  # poses; a frame fits any three


def sheet_problem(base: Calibration, new: Dataset) -> DataProblem | None:
    """Mistake in a table of new measurements; None where there is none, or where the arm may be the cause.

    Only the scanner's frame is fitted: all else is predicted by the earlier fit.
    """
    now_mm = _rmse_mm(base, new)
    if np.isinf(now_mm) or not is_beyond_effects(now_mm, new.robot):
        return None
    tried = {hypothesis: _rmse_mm(base, hypothesis.of_dataset(new)) for hypothesis in _hypotheses(base, new)}
    least = min(tried.values(), default=np.inf)
    if least >= _FALLS_TO * now_mm or is_beyond_effects(least, new.robot):
        return None
    good = [hypothesis for hypothesis, rmse_mm in tried.items() if rmse_mm < min(_AS_GOOD * least, _FALLS_TO * now_mm)]
    best, *rivals = sorted(simplest_of(good), key=tried.__getitem__)
    return DataProblem(best, best.of_dataset(new), now_mm, tried[best], np.inf, tuple(rivals))


def change_of(problem: DataProblem) -> Change:
    """Mistake in a table of check poses in the form of a change, its size being the number of poses or joints."""
    if problem.kind == ROW_ORDER:
        return Change(POSE_ORDER, None, "", float(problem.hypothesis.moved_rows), 0.0, "poses", 0.0, ())
    joint = problem.joints[0] if len(problem.joints) == 1 else None
    return Change(problem.kind, joint, "", float(max(len(problem.joints), 1)), 0.0, "joints", 0.0, ())


def _hypotheses(base: Calibration, new: Dataset) -> Iterable[DataHypothesis]:
    """Hypotheses on mistakes in a table of check poses."""
    names = column_names(new.robot)
    yield from (of_reading(reading, names) for reading in simple_readings(new.robot.is_revolute))
    every = replace(new, poses=replace(new.poses, role=np.full(len(new.poses), "train")))
    sample = training_sample(every)
    if sample is not None:
        yield from of_units(base.robot, sample)
    yield from of_shifts(new)
    poses, points_mm = points_of_poses(new)
    check = CheckPoints.of(base, new)
    measured = check.observed.points
    if len(np.unique(measured.target)) == 1:
        source = matched_rows(check.at_mm[np.unique(measured.pose, return_index=True)[1]], points_mm)
        if source is not None and not np.array_equal(source, np.arange(len(source))):
            yield of_matching(new, poses, poses[source])


def _rmse_mm(base: Calibration, new: Dataset) -> float:
    """3D RMSE, mm, of new points by the earlier fit, with the scanner's frame refitted; inf for too few poses."""
    if new.points is None or len(np.unique(new.points.pose)) < _FEWEST:
        return np.inf
    check = CheckPoints.of(base, new)
    return rms_length(check.errors_mm(check.anew_T_base))
