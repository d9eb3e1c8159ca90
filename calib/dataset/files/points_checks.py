"""Warnings about measured points: a unit other than the millimetre, rows that were copied."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Points, Poses
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot
from calib.units import UNITS_MM

_ALIKE = (
    0.2  # of the ratio's logarithm: the true arm is closer to its table than that, other units are farther
)
_FEWEST_POINTS = 3
_LEAST_SPREAD_MM = 20.0  # of the nominal arm's points; below it noise decides the ratio
_POSES_IN_A_SOCKET = 5  # at which one place is met; a row copied by mistake stands there twice


def unit_doubt(robot: Robot, poses: Poses, points: Points) -> str:
    """Which other unit the points seem to have, as a sentence; "" where they are millimetres or it cannot be decided.

    Neither turn nor shift of the scanner changes how far points spread about their mean. Each setup's spread is held
    against that of the nominal arm at the same poses; a ratio of 1 / 25.4 is that of inches.
    """
    nominal_mm = kinematics.target_points(robot, poses.q)[points.pose]
    measured = nominal = 0.0
    for setup in np.unique(poses.setup):
        of = (poses.setup[points.pose] == setup) & (points.target == "jig")
        if np.count_nonzero(of) >= _FEWEST_POINTS:
            measured += _square_spread(points.xyz_mm[of])
            nominal += _square_spread(nominal_mm[of])
    if nominal < np.count_nonzero(points.target == "jig") * _LEAST_SPREAD_MM**2 or measured <= 0.0:
        return ""
    ratio = float(np.sqrt(measured / nominal))
    for unit, in_mm in UNITS_MM.items():
        if abs(np.log(ratio * in_mm)) < _ALIKE:
            return (
                f"the points spread {ratio:.3g} times as far as the arm of robot.toml moves; columns are mm, these "
                f"look like {unit}, multiply them by {in_mm:g}"
            )
    return ""


def _square_spread(points_mm: Array) -> float:
    return float(np.sum((points_mm - points_mm.mean(axis=0)) ** 2))


def copied_rows(poses: Poses, points: Points) -> list[tuple[int, int]]:
    """Rows that have an earlier one's setup, target and coordinates to the last bit: (that one, this one).

    None where most points lie at places that five or more different joint vectors share: the tool then sat in sockets
    whose coordinates are known, and nothing was copied.
    """
    rows: dict[tuple[str, str, bytes], list[int]] = {}
    for row, (pose, target) in enumerate(zip(points.pose, points.target, strict=True)):
        place = (str(poses.setup[pose]), str(target), points.xyz_mm[row].tobytes())
        rows.setdefault(place, []).append(row)
    in_sockets = sum(len(same) for same in rows.values() if _is_socket(poses, points, same))
    if 2 * in_sockets > len(points):
        return []
    return sorted(((same[0], row) for same in rows.values() for row in same[1:]), key=lambda pair: pair[1])


def _is_socket(poses: Poses, points: Points, rows: list[int]) -> bool:
    """Whether points at one place were met with five or more different joint vectors."""
    return (
        len(rows) >= _POSES_IN_A_SOCKET
        and len(np.unique(poses.q[points.pose[rows]], axis=0)) >= _POSES_IN_A_SOCKET
    )
