"""Detection of an instrument, or a target, that was moved in the middle of a campaign.

The latest poses are fitted with all others as seen from a place of their own, and as of a target of their own: where
the instrument or the target was moved, that lowers the residual by far more than the six or three parameters of a move
do by chance, and what is left of the disagreement is small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.brief import Brief
from calib.calibration.calibrate import fit_measured
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.errors import CalibError
from calib.fitting.observations import Observations, predict_points
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import TOOL_POINT, Target
from calib.options import FitOptions
from calib.statistics import f_sf, rms_length

SHORTEST_RUN = 4
"""Least number of poses that show a move: three place a frame, one more tests it."""
_LONGEST_RUN = 40  # poses that are considered since a move
_FALSE_ALARMS = 1e-6  # of a test; the misfit of a model is alike at neighbouring poses, so that p is too small
_LEFT = 0.5  # share of the disagreement that the move may leave
_FARTHEST_MM = 20.0  # tolerance of how far a target moves on the tool
_MARK = " since "  # in the name of a placement that was found

What = Literal["instrument", "target"]
_WHATS: dict[What, int] = {"instrument": 6, "target": 3}  # parameters of each move


@dataclass(frozen=True)
class Shift(Brief):
    """Move of the instrument, or of the target on the tool, in the middle of a campaign."""

    what: What
    first: str  # pose since which
    before: str  # pose before it
    moved_mm: float  # at the middle of the points since
    turned_rad: float  # 0 for a target, whose point alone is measured
    off_mm: float  # rms by which the points since are off without it
    left_mm: float  # with it


def placed_anew(dataset: Dataset, arrived: Sequence[str], shifts: Sequence[Shift]) -> Dataset:
    """The dataset with another placement of the instrument, or another target on the tool, since each move.

    Poses count in the order in which they arrived.
    """
    for shift in shifts:
        if shift.first in arrived:
            dataset = _moved(dataset, arrived[arrived.index(shift.first) :], shift.what)
    return dataset


def find_shift(dataset: Dataset, arrived: Sequence[str], options: FitOptions) -> Shift | None:
    """Move since one of the latest poses; None where none is seen.

    Args:
        dataset: with the points of all poses, and the moves found before (`placed_anew`).
        arrived: ids of the poses with points, in the order in which they arrived.
        options: of the fits.
    """
    poses = dataset.poses
    trained = [i for i in arrived if not poses.is_test[poses.index(i)]]
    kinds = {pose_id: (str(poses.setup[poses.index(pose_id)]), _target(dataset, pose_id)) for pose_id in trained}
    alike = next((k for k, i in enumerate(reversed(trained)) if kinds[i] != kinds[trained[-1]]), len(trained))
    placed = trained[len(trained) - alike :]
    longest = min(_LONGEST_RUN, len(placed) // 2)
    if longest < SHORTEST_RUN:
        return None
    plain = replace(options, robust=False)
    try:
        one = fit_measured(dataset, plain)
        if not any(
            _p_value(one, _with_run(dataset, placed, SHORTEST_RUN, w, plain), w) < _FALSE_ALARMS for w in _WHATS
        ):
            return None
        tried = [(count, what) for count in range(SHORTEST_RUN, longest + 1) for what in _WHATS]
        fits = [_with_run(dataset, placed, count, what, plain) for count, what in tried]
        best = int(
            np.argmin(
                [_cost(fit) * (1.0 + _WHATS[what] / fit.fit.rows) for fit, (_, what) in zip(fits, tried, strict=True)]
            )
        )
        count, what = tried[best]
        return _sized(dataset, placed[-count:], placed[-count - 1], what, plain)
    except CalibError:  # too few poses are left for a fit
        return None


def _target(dataset: Dataset, pose_id: str) -> str:
    """Names of the targets measured at a pose."""
    points = dataset.points
    assert points is not None
    return " ".join(sorted(set(map(str, points.target[points.pose == dataset.poses.index(pose_id)]))))


def _moved(dataset: Dataset, run: Sequence[str], what: What) -> Dataset:
    """The dataset with the instrument, or the target on the tool, in a place of its own for some poses."""
    poses, points = dataset.poses, dataset.points
    assert points is not None
    rows = np.isin(poses.ids, list(run))
    if what == "instrument":
        name = f"{poses.setup[poses.index(run[0])]}{_MARK}{run[0]}"
        return replace(dataset, poses=replace(poses, setup=np.where(rows, name, poses.setup)))
    moved = f"{TOOL_POINT}{_MARK}{run[0]}"
    target = np.where(rows[points.pose] & (points.target == _target(dataset, run[0])), moved, points.target)
    robot = dataset.robot
    further = (*robot.targets, Target(moved, (0.0, 0.0, 0.0), tolerance_mm=_FARTHEST_MM))
    return replace(dataset, robot=replace(robot, targets=further)).with_points(replace(points, target=target))


def _with_run(dataset: Dataset, placed: Sequence[str], count: int, what: What, options: FitOptions) -> Calibration:
    """Fit with the latest poses seen by a moved instrument, or of a moved target."""
    return fit_measured(_moved(dataset, placed[-count:], what), options)


def _cost(calibration: Calibration) -> float:
    return calibration.fit.iterations[-1].cost


def _p_value(one: Calibration, two: Calibration, what: What) -> float:
    """Probability that chance lets the parameters of a move lower the cost as much (F-test)."""
    dof = two.fit.degrees_of_freedom
    if not dof > 1.0 or not _cost(two) > 0.0:
        return 1.0
    ratio = (_cost(one) - _cost(two)) / _WHATS[what] / (_cost(two) / dof)
    return float(f_sf(max(ratio, 0.0), _WHATS[what], dof))


def _sized(dataset: Dataset, run: Sequence[str], before: str, what: What, options: FitOptions) -> Shift | None:
    """Size of a move since a run of poses by a fit of all others; None where it leaves too much."""
    others = fit_measured(dataset.leave_out(tuple(run)), options)
    observed = Observations.of(dataset, np.isin(dataset.poses.ids, list(run)) & ~dataset.poses.is_test)
    placed = others.after.scanner_T_base.get(str(observed.setup[0]))
    if placed is None:
        return None
    predicted_mm = frames.apply(placed, predict_points(others.model, others.fit.x, observed))
    off = observed.points.xyz_mm - predicted_mm
    if what == "instrument":
        columns = frames.frame_motion(predicted_mm, predicted_mm.mean(axis=0))
    else:
        columns = placed[:3, :3] @ _base_R_tool(dataset, observed)
    flat = columns.reshape(-1, columns.shape[-1])
    motion = np.linalg.lstsq(flat, off.ravel(), rcond=None)[0]
    off_mm, left_mm = rms_length(off), rms_length(off - (flat @ motion).reshape(off.shape))
    if left_mm > _LEFT * off_mm:
        return None
    moved_mm, turned_rad = float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))
    return Shift(what, run[0], before, moved_mm, turned_rad, off_mm, left_mm)


def _base_R_tool(dataset: Dataset, observed: Observations) -> Array:
    """Nominal attitude (M, 3, 3) of the tool at the observed points."""
    robot = dataset.robot
    chain = nominal_chain(robot, dataset.poses.q[observed.points.pose])
    return chain.base_T_frame[:, -1, :3, :3]
