"""Warnings about measured points: a wrong unit, a wrong order of quaternions, copied rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calib import frames
from calib.array_types import Array
from calib.dataset.dataset import Points, Poses
from calib.dataset.files.csv_table import TableFile, short
from calib.errors import is_one_line
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot
from calib.rendering import numbers
from calib.units import UNITS_MM

_ALIKE = 0.2  # of the ratio's logarithm: the true arm is closer to its table than that, other units are farther
_FEWEST_POINTS = 3
_LEAST_SPREAD_MM = 20.0  # of the nominal arm's points; below it noise decides the ratio
_FEWEST_ORIENTATIONS = 8
_ENOUGH_ORIENTATIONS = 500
_FITS_DEG = 5.0  # a nominal arm is closer to its measured orientations than that
_FAR_BETTER = 5.0  # times the other order's misfit, or degrees
_ROUNDS = 20
_MISSED = 0.1  # of the points' spread across their longest extent, by which they may miss the nominal arm's
_MOST_NAMED = 12  # poses in a note
_POSES_IN_A_SOCKET = 5  # at which one place is met; a row copied by mistake stands there twice


def require_targets(file: TableFile, names: Sequence[str], robot: Robot) -> None:
    """Raise DatasetError, with the line, where a row names a target that robot.toml does not define."""
    on_arm = [target.name for target in robot.targets]
    for row, name in enumerate(names):
        found = f"found {short(name)}"
        if not robot.carries_scanner and name not in ("jig", *on_arm):
            remedy = (
                f"robot.toml knows {', '.join(dict.fromkeys(('jig', *on_arm)))}; add [[targets]] with this name and "
                "its xyz_mm on the tool, or with joint = 3 on the link that joint 3 moves"
            )
            raise file.error(row, "target", found, remedy)
        if robot.carries_scanner and name in on_arm:
            remedy = "a scanner on the flange sees targets in the room; give them names of their own"
            raise file.error(row, "target", f"{found}, which robot.toml has on the arm", remedy)
        if robot.carries_scanner and not is_one_line(name):
            raise file.error(row, "target", found, "a name is one line without control characters")


def unit_doubt(robot: Robot, poses: Poses, points: Points, unit: str = "mm") -> str:
    """Sentence that names the unit the points seem to have; "" where `unit` fits or none can be determined.

    The scanner's pose does not change how far points spread about their mean. Each setup's spread is compared with that
    of the nominal arm at the same poses; a ratio of 1 / 25.4 means inches. For a scanner on the flange this does not
    hold, as the scanner's own place is in the same unit: the result is "".
    """
    if robot.carries_scanner:
        return ""
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
    if unit == "m" and abs(np.log(ratio / 1000.0)) < _ALIKE:
        return (
            f"the points spread {ratio:.3g} times as far as the arm of robot.toml moves; columns are m, these look "
            "like millimetres, name them x_mm, y_mm, z_mm"
        )
    for other, in_mm in UNITS_MM.items() if unit == "mm" else ():
        if abs(np.log(ratio * in_mm)) < _ALIKE:
            return (
                f"the points spread {ratio:.3g} times as far as the arm of robot.toml moves; columns are mm, these "
                f"look like {other}, multiply them by {in_mm:g}"
            )
    return ""


def _square_spread(points_mm: Array) -> float:
    return float(np.sum((points_mm - points_mm.mean(axis=0)) ** 2))


def order_doubt(robot: Robot, poses: Poses, points: Points, by_order: Mapping[str, Array]) -> str:
    """Sentence that names another order of the quaternions which fits the nominal arm far better; "" where none does.

    Measured orientations are Y B X: B (M, 3, 3) the orientations of the nominal arm's tool, Y the rotation
    scanner_R_base and X the jig's rotation on the tool, both unknown constants. Y is taken from the points where one
    order agrees with them. For a scanner on the flange Y is its rotation on the flange, B that of the base and X that
    of the jig in the world.

    Args:
        by_order: the orientations (M, 3, 3) read in either order of the columns, "wxyz" and "xyzw"; NaN: not known.
    """
    assert points.orientations is not None
    setups = poses.setup[points.pose]
    known = points.orientations.known
    if not known.any():
        return ""
    names, counts = np.unique(setups[known], return_counts=True)
    rows = np.flatnonzero(known & (setups == names[np.argmax(counts)]))  # one station of the scanner, one Y
    if len(rows) < _FEWEST_ORIENTATIONS:
        return ""
    rows = rows[:: -(-len(rows) // _ENOUGH_ORIENTATIONS)]
    chain = kinematics.nominal_chain(robot, poses.q[points.pose[rows]])
    tool, by_points = chain.base_T_frame[:, -1, :3, :3], None
    if robot.carries_scanner:
        tool = np.swapaxes(chain.base_T_flange[:, :3, :3], 1, 2)
    else:
        by_points = _turn_by_points(kinematics.tool_points(robot, chain), points.xyz_mm[rows])
    for placed in (None,) if by_points is None else (by_points, None):
        as_read_deg = _misfit_deg(tool, points.orientations.scanner_R_jig[rows], placed)
        fits = {order: _misfit_deg(tool, turns[rows], placed) for order, turns in by_order.items()}
        order = min(fits, key=fits.__getitem__)
        if fits[order] <= _FITS_DEG:
            break
    if fits[order] > _FITS_DEG or as_read_deg < _FAR_BETTER * max(fits[order], 1.0):
        return ""
    return (
        f"the orientations miss those of the nominal arm by {as_read_deg:.3g} deg (rms) as they are read, and by "
        f"{fits[order]:.3g} deg where the four columns hold {' '.join(order)} from left to right; if they do, write "
        f'quaternion = "{order}" under [units] in dataset.toml'
    )


def _turn_by_points(nominal_mm: Array, measured_mm: Array) -> Array | None:
    """Rotation scanner_R_base (3, 3) fitted to the points (M, 3); None where they do not fit the nominal arm."""
    frame = frames.best_fit_transform(nominal_mm, measured_mm)
    missed = float(np.sum((frames.apply(frame, nominal_mm) - measured_mm) ** 2))
    _, second, _ = np.linalg.svd(nominal_mm - nominal_mm.mean(axis=0), compute_uv=False)
    far_from_a_line = second > _LEAST_SPREAD_MM * np.sqrt(len(nominal_mm))
    return frame[:3, :3] if far_from_a_line and missed < (_MISSED * second) ** 2 else None


def _misfit_deg(tool: Array, measured: Array, placed: Array | None) -> float:
    """RMS angle, deg, from measured rotations (M, 3, 3) to Y @ tool @ X, with fitted rotations X and, unless given, Y.

    The sum of tr(measured^T Y tool X) is bilinear in the entries of Y and X: alternating least squares starts from its
    leading singular vectors, projected onto rotations.
    """
    if placed is None:
        form = np.einsum("nad,nbc->abcd", measured, tool).reshape(9, 9)
        leading = np.linalg.svd(form)[2][0].reshape(3, 3)
        x = frames.mean_rotation(leading[None] * np.sign(np.linalg.det(leading)))
    else:
        x = frames.mean_rotation(np.swapaxes(placed @ tool, 1, 2) @ measured)
    y = np.eye(3) if placed is None else placed
    for _ in range(_ROUNDS if placed is None else 0):
        y = frames.mean_rotation(measured @ np.swapaxes(tool @ x, 1, 2))
        x = frames.mean_rotation(np.swapaxes(y @ tool, 1, 2) @ measured)
    angle = frames.rotvec_from_rotation(np.swapaxes(y @ tool @ x, 1, 2) @ measured)
    return float(np.degrees(np.sqrt(np.mean(np.sum(angle**2, axis=1)))))


def copied_rows(poses: Poses, points: Points) -> list[tuple[int, int]]:
    """Pairs (earlier row, copy) of rows that agree in setup, target and, to the last bit, coordinates.

    Empty where most points lie at places that five or more different joint vectors share: the tool then sat in sockets
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
    """Whether the points `rows`, all at one place, were measured with five or more different joint vectors."""
    return len(rows) >= _POSES_IN_A_SOCKET and len(np.unique(poses.q[points.pose[rows]], axis=0)) >= _POSES_IN_A_SOCKET


def unmeasured_note(path: Path, poses: Poses, points: Points) -> tuple[str, ...]:
    """A note with the number and names of poses without a point; () where all have one."""
    without = np.setdiff1d(np.arange(len(poses)), points.pose)
    if not len(without):
        return ()
    names = numbers.in_short([poses.ids[i] for i in without], _MOST_NAMED)
    tests = int(np.count_nonzero(poses.is_test[without]))
    return (
        f"{path}: no point for {len(without)} of {len(poses)} poses, {len(without) - tests} to train on and {tests} to "
        f"test; they are left out: {names}",
    )
