"""Whether a sheet of check poses is the mistake: its signs, order, units or rows, by what the earlier fit predicts."""

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
from calib.monitoring.change_tests import Change

POSE_ORDER = "pose_order"
_FALLS_TO = 0.1  # share of the error that may be left: no change of an arm looks like another sheet
_AS_GOOD = 2.0  # times the least error, which a simpler hypothesis may leave
_FEWEST = 4  # points; a frame is laid upon three of any arm's


def sheet_problem(base: Calibration, new: Dataset) -> DataProblem | None:
    """What is wrong with the sheet of new measurements; None where nothing is, or what is off may be the arm's.

    The scanner's place is free, and nothing else: the earlier fit says where the points have to lie.
    """
    if new.points is None or len(new.points) < _FEWEST:
        return None
    now_mm = _left_mm(base, new)
    if now_mm is None or not is_beyond_effects(now_mm, new.robot):
        return None
    names = column_names(new.robot)
    tried: dict[DataHypothesis, float] = {}
    for hypothesis in _hypotheses(base, new, names):
        left_mm = _left_mm(base, hypothesis.of_dataset(new))
        if left_mm is not None and left_mm < _FALLS_TO * now_mm and not is_beyond_effects(left_mm, new.robot):
            tried[hypothesis] = left_mm
    if not tried:
        return None
    least = min(tried.values())
    good = [h for h, left_mm in tried.items() if left_mm < _AS_GOOD * least]
    best, *rivals = sorted(simplest_of(good), key=tried.__getitem__)
    return DataProblem(best, best.of_dataset(new), now_mm, tried[best], np.inf, tuple(rivals))


def found_of(problem: DataProblem) -> Change:
    """What is wrong with the sheet as a change of the cell; its size is how many poses or joints it concerns."""
    if problem.kind == ROW_ORDER:
        return Change(POSE_ORDER, None, "", float(problem.hypothesis.moved_rows), 0.0, "poses", 0.0, ())
    joint = problem.joints[0] if len(problem.joints) == 1 else None
    return Change(problem.kind, joint, "", float(max(len(problem.joints), 1)), 0.0, "joints", 0.0, ())


def _hypotheses(base: Calibration, new: Dataset, names: tuple[str, ...]) -> Iterable[DataHypothesis]:
    yield from (of_reading(reading, names) for reading in simple_readings(new.robot.is_revolute))
    every = replace(new, poses=replace(new.poses, role=np.full(len(new.poses), "train")))
    sample = training_sample(every)
    if sample is not None:
        yield from of_units(base.robot, sample)
    yield from of_shifts(new)
    poses, points_mm = points_of_poses(new)
    at_mm = _predicted_mm(base, new)
    assert new.points is not None
    first = [int(np.flatnonzero(new.points.pose == pose)[0]) for pose in poses]
    if len(np.unique(new.points.target)) == 1:
        source = matched_rows(at_mm[first], points_mm)
        if source is not None and not np.array_equal(source, np.arange(len(source))):
            yield of_matching(new, poses, poses[source])


def _observed(base: Calibration, new: Dataset) -> Observations:
    later = replace(new, poses=new.poses.measured_later())
    observed = Observations.of(later, np.ones(len(new.poses), dtype=bool))
    return with_nominal_scanner_frames(observed, base.model.placed_robot)


def _predicted_mm(base: Calibration, new: Dataset) -> Array:
    return predict_points(base.model, base.fit.x, _observed(base, new))


def _left_mm(base: Calibration, new: Dataset) -> float | None:
    """RMS of the 3D error by the earlier fit with the scanner's place free; None where too few points are left."""
    if new.points is None or len(new.points) < _FEWEST:
        return None
    observed = _observed(base, new)
    at_mm, measured_mm = predict_points(base.model, base.fit.x, observed), observed.points.xyz_mm
    frame = fit_scanner_frame(at_mm, measured_mm, observed.covariance_mm2)
    return float(np.sqrt(np.mean(np.sum((apply(frame, at_mm) - measured_mm) ** 2, axis=1))))
