"""Units of columns without a unit in their name, by the agreement of the numbers with the nominal arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array_types import Array
from calib.frames import apply, best_fit_transform
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Robot
from calib.statistics import rms, rms_length
from calib.text_files.column_names import ANGLES_RAD, LENGTHS_MM

_RADIANS_AT_MOST = 4.0 * np.pi  # of a joint that turns
_METRES_AT_MOST = 5.0  # of a joint that slides
_CLEARLY = 0.5  # of the other unit's misfit
_LIKELY = ("mm", "m", "in", "cm")


def joint_units(robot: Robot, values: Array, named: Sequence[str], points: Array | None) -> tuple[list[str], str]:
    """Units of the joints' columns, and the reason; "" where the columns' names give all units.

    values  # (N, n) in the file's units; points  # (N, 3) in the file's unit, where each row has one
    """
    turns = robot.is_revolute
    angle, length, how = _angle_unit(robot, values, named, points), "mm", []
    slides = values[:, ~turns]
    if slides.size and np.nanmax(np.abs(slides)) <= _METRES_AT_MOST:
        length = "m"
    units = [unit or (angle if turning else length) for unit, turning in zip(named, turns, strict=True)]
    if any(not unit and turning for unit, turning in zip(named, turns, strict=True)):
        largest = float(np.nanmax(np.abs(values[:, turns])))
        how.append(f"angles are taken for {angle}, their largest being {largest:.4g}")
    if any(not unit and not turning for unit, turning in zip(named, turns, strict=True)):
        how.append(f"slides are taken for {length}, their largest being {float(np.nanmax(np.abs(slides))):.4g}")
    return units, "; ".join(how)


def _angle_unit(robot: Robot, values: Array, named: Sequence[str], points: Array | None) -> str:
    turning = values[:, robot.is_revolute]
    if not turning.size or np.nanmax(np.abs(turning)) > _RADIANS_AT_MOST:
        return "deg"
    if points is not None and len(points) >= 6 and "rad" not in named and "deg" not in named:
        scales = {unit: np.where(robot.is_revolute, scale, 1.0) for unit, scale in ANGLES_RAD.items()}
        misfit = {unit: misfit_share(robot, values * scale, points) for unit, scale in scales.items()}
        # Where the arm explains neither, because a sign or the robot is wrong, small numbers are likelier radians.
        return "deg" if misfit["deg"] < _CLEARLY * misfit["rad"] else "rad"
    return "rad"


def misfit_share(robot: Robot, q: Array, points: Array) -> float:
    """Misfit of the nominal arm to points (N, 3) at the best scale, as a share of their spread.

    q  # (N, n) rad, mm
    """
    known = np.isfinite(q).all(axis=1) & np.isfinite(points).all(axis=1)
    mine, seen = target_points(robot, q[known]), points[known]
    if _spread(mine) == 0.0 or _spread(seen) == 0.0:
        return np.inf
    scaled = mine * (_spread(seen) / _spread(mine))
    return rms(apply(best_fit_transform(scaled, seen), scaled) - seen) / _spread(seen)


def length_unit(robot: Robot, q: Array, points: Array) -> tuple[str, float]:
    """Unit of points by their spread relative to the nominal arm's, and the ratio (>= 1) of the spreads in that unit.

    q  # (N, n) rad, mm; points  # (N, 3), of the same poses
    """
    known = np.isfinite(q).all(axis=1) & np.isfinite(points).all(axis=1)
    mine, seen = _spread(target_points(robot, q[known])), _spread(points[known])
    if mine == 0.0 or seen == 0.0:
        return "mm", 1.0
    off = {unit: abs(np.log(LENGTHS_MM[unit] * seen / mine)) for unit in _LIKELY}
    best = min(off, key=lambda unit: off[unit])
    return best, float(np.exp(off[best]))


def _spread(points: Array) -> float:
    return rms_length(points - points.mean(axis=0)) if len(points) > 1 else 0.0
