"""Mistakes in a table of check poses (signs, order, units, rows), found by the earlier fit's predictions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from calib.array_types import Array
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
from calib.fitting.observations import Observations, predict_points, with_nominal_scanner_frames
from calib.fitting.scanner_frame import fit_scanner_frame
from calib.frames import apply
from calib.statistics import rms_length
from calib.validation.cell_changes import Change

POSE_ORDER = "pose_order"
_FALLS_TO = 0.1  # share of the error that may remain: no change of an arm looks like another sheet
_AS_GOOD = 2.0  # times the least error, up to which a simpler hypothesis is as good
_FEWEST = 4  # points; a frame fits any three


def sheet_problem(base: Calibration, new: Dataset) -> DataProblem | None:
    """Mistake in a table of new measurements; None where there is none, or where the arm may be the cause.

    Only the scanner's frame is fitted: all else is predicted by the earlier fit.
    """
    now_mm = _rmse_mm(base, new)
    if np.isinf(now_mm) or not is_beyond_effects(now_mm, new.robot):
        return None
    hypotheses = _hypotheses(base, new, column_names(new.robot))
    tried = {hypothesis: _rmse_mm(base, hypothesis.of_dataset(new)) for hypothesis in hypotheses}
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


def _hypotheses(base: Calibration, new: Dataset, names: tuple[str, ...]) -> Iterable[DataHypothesis]:
    """Hypotheses on mistakes in a table of check poses with given joint columns."""
    yield from (of_reading(reading, names) for reading in simple_readings(new.robot.is_revolute))
    every = replace(new, poses=replace(new.poses, role=np.full(len(new.poses), "train")))
    sample = training_sample(every)
    if sample is not None:
        yield from of_units(base.robot, sample)
    yield from of_shifts(new)
    poses, points_mm = points_of_poses(new)
    observed, at_mm = _predicted(base, new)
    first = [int(np.flatnonzero(observed.points.pose == pose)[0]) for pose in poses]
    if len(np.unique(observed.points.target)) == 1:
        source = matched_rows(at_mm[first], points_mm)
        if source is not None and not np.array_equal(source, np.arange(len(source))):
            yield of_matching(new, poses, poses[source])


def _predicted(base: Calibration, new: Dataset) -> tuple[Observations, Array]:
    """Observations of all new points, and their places (M, 3) by the earlier fit, base frame."""
    observed = Observations.of_all(replace(new, poses=new.poses.measured_later()))
    observed = with_nominal_scanner_frames(observed, base.model.placed_robot)
    return observed, predict_points(base.model, base.fit.x, observed)


def _rmse_mm(base: Calibration, new: Dataset) -> float:
    """3D RMSE, mm, of new points by the earlier fit, with the scanner's frame refitted; inf for too few points."""
    if new.points is None or len(new.points) < _FEWEST:
        return np.inf
    observed, at_mm = _predicted(base, new)
    measured_mm = observed.points.xyz_mm
    frame = fit_scanner_frame(at_mm, measured_mm, observed.covariance_mm2)
    return rms_length(apply(frame, at_mm) - measured_mm)
