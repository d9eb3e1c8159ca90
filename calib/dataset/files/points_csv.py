"""points.csv, read, checked and written: measured points in the scanner's frame, and orientations where it has them.

Optional columns of a full pose: `qw, qx, qy, qz`, the unit quaternion of scanner_R_jig (all four empty where it is not
known); the covariance of its error as a small turn about the scanner's axes, `rxx_rad2, rxy_rad2, rxz_rad2, ryy_rad2,
ryz_rad2, rzz_rad2`; and that of the point's error with the turn's, `x_rx_mm_rad, x_ry_mm_rad ... z_rz_mm_rad`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.dataset.dataset import Orientations, Points, Poses
from calib.dataset.files.csv_table import TableFile
from calib.dataset.files.points_checks import copied_rows, unit_doubt
from calib.dataset.files.poses_csv import short
from calib.errors import DatasetError
from calib.kinematics.robot import Robot

COVARIANCE_COLUMNS = ("sxx_mm2", "sxy_mm2", "sxz_mm2", "syy_mm2", "syz_mm2", "szz_mm2")
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
TURN_COLUMNS = ("rxx_rad2", "rxy_rad2", "rxz_rad2", "ryy_rad2", "ryz_rad2", "rzz_rad2")
CROSS_COLUMNS = tuple(f"{point}_r{turn}_mm_rad" for point in "xyz" for turn in "xyz")
_UPPER = np.triu_indices(3)
FARTHEST_MM = 1e9
LEAST_SIGMA_MM, MOST_SIGMA_MM = 1e-6, 1e3  # as declared for an instrument; none is better or worse than that
LEAST_SIGMA_DEG, MOST_SIGMA_DEG = 1e-6, 90.0
_LEAST_OF_A_POINT = (
    0.01  # times those: corners of scans without noise are known as well as rounding lets them
)
_LEAST_EIGENVALUE = 1e-12  # of a covariance scaled to a unit diagonal: below it lies rounding


def load_points(path: Path, robot: Robot, poses: Poses) -> tuple[Points, list[str]]:
    """The points and warnings about them. Raises DatasetError."""
    file = TableFile.load(path)
    file.require(["pose", "x_mm", "y_mm", "z_mm"])
    ids = file.text("pose")
    index = {pose_id: i for i, pose_id in enumerate(poses.ids)}
    for row, pose_id in enumerate(ids):
        if pose_id not in index:
            raise file.error(
                row, "pose", f"{short(pose_id)} is not in poses.csv", "remove the row or add the pose"
            )
    measured = set(ids)
    missing = [pose_id for pose_id in poses.ids if pose_id not in measured]
    if missing:
        raise DatasetError(
            f"{path}: no point for pose {', '.join(missing[:5])}{' ...' if len(missing) > 5 else ''} "
            f"({len(missing)} of {len(poses)}); add the rows or remove the poses"
        )
    xyz_mm = file.numbers(["x_mm", "y_mm", "z_mm"])
    target = np.array(file.text("target") if "target" in file else ["jig"] * len(file))
    known_targets = ("jig", *(t.name for t in robot.targets))
    for row, name in enumerate(target):
        if name not in known_targets:
            raise file.error(
                row, "target", f"found {short(name)}", f"robot.toml knows {', '.join(known_targets)}"
            )
    _check_size(file, xyz_mm)
    covariance = None
    if _any(file, COVARIANCE_COLUMNS):
        limits = (_LEAST_OF_A_POINT * LEAST_SIGMA_MM, MOST_SIGMA_MM)
        covariance = _load_covariance(file, COVARIANCE_COLUMNS, "mm", limits)
    orientations = None
    if _any(file, (*QUATERNION_COLUMNS, *TURN_COLUMNS, *CROSS_COLUMNS)):
        orientations = _load_orientations(file, target, covariance)
    pose = np.array([index[pose_id] for pose_id in ids], dtype=np.int64)
    points = Points(pose, xyz_mm, target, covariance, orientations)
    return points, _warnings(file, robot, poses, points)


def _check_size(file: TableFile, xyz_mm: Array) -> None:
    """Raise DatasetError where a coordinate is farther away than `FARTHEST_MM`."""
    beyond = np.argwhere(np.abs(xyz_mm) > FARTHEST_MM)
    if len(beyond):
        row, axis = map(int, beyond[0])
        found = f"found {xyz_mm[row, axis]:g} mm, beyond {FARTHEST_MM / 1e6:g} km"
        raise file.error(row, f"{'xyz'[axis]}_mm", found, "correct it or remove the row")


def _warnings(file: TableFile, robot: Robot, poses: Poses, points: Points) -> list[str]:
    """Warnings about values that are possible but probably mistakes."""
    warnings = []
    doubt = unit_doubt(robot, poses, points)
    extent_mm = float(np.ptp(points.xyz_mm, axis=0).max())
    if not doubt and len(poses) > 1 and 0.0 < extent_mm < 5.0 and np.ptp(poses.q, axis=0).max() > 0.2:
        doubt = f"all points lie within {extent_mm:.3g} mm; columns are mm, these look like metres"
    if doubt:
        warnings.append(f"{file.path}: {doubt}")
    copies = copied_rows(poses, points)
    if copies:
        earlier, row = copies[0]
        more = f" and {len(copies) - 1} more rows do alike" if len(copies) > 1 else ""
        warnings.append(
            f"{file.path}: line {file.line(row)} has the coordinates of line {file.line(earlier)} to the last digit"
            f"{more}; a second measurement differs, so remove rows that were copied"
        )
    return warnings


def _any(file: TableFile, columns: Sequence[str]) -> bool:
    return any(column in file for column in columns)


def _load_covariance(
    file: TableFile, columns: tuple[str, ...], unit: str, limits: tuple[float, float]
) -> Array:
    """(M, 3, 3) of the six columns of its upper triangle; its sigmas lie within the limits, in every direction."""
    file.require(columns)
    values = file.numbers(list(columns))
    covariance = np.zeros((len(values), 3, 3))
    covariance[:, _UPPER[0], _UPPER[1]] = values
    covariance[:, _UPPER[1], _UPPER[0]] = values
    place = f"{columns[0]} ... {columns[-1]}"
    _check_positive(file, covariance, place, f"give a covariance in {unit}^2")
    sigma = np.sqrt(np.linalg.eigvalsh(covariance)[:, [0, -1]].clip(min=0.0))  # (M, 2) least and most
    bad = np.argwhere((sigma < limits[0]) | (sigma > limits[1]))
    if len(bad):
        row, end = map(int, bad[0])
        raise file.error(
            row,
            place,
            f"found a sigma of {sigma[row, end]:.3g} {unit} in one direction",
            f"a sigma lies between {limits[0]:.4g} and {limits[1]:.4g} {unit}; give a covariance in {unit}^2",
        )
    return covariance


def _check_positive(file: TableFile, covariance: Array, columns: str, remedy: str) -> None:
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=1, axis2=2)))
    scale = np.where(scale > 0.0, scale, 1.0)  # mm and rad side by side
    least = np.linalg.eigvalsh(covariance / scale[:, :, None] / scale[:, None, :])[:, 0]
    bad = np.flatnonzero(least <= _LEAST_EIGENVALUE)
    if len(bad):
        raise file.error(int(bad[0]), columns, "the covariance is not positive definite", remedy)


def _load_orientations(
    file: TableFile, target: NDArray[np.str_], covariance_mm2: Array | None
) -> Orientations:
    file.require(QUATERNION_COLUMNS)
    more = [c for c in (*TURN_COLUMNS, *CROSS_COLUMNS) if c in file]
    cells = {c: file.text(c, allow_empty=True) for c in (*QUATERNION_COLUMNS, *more)}
    known = np.array([any(cells[c][row] for c in QUATERNION_COLUMNS) for row in range(len(file))], dtype=bool)
    for row in np.flatnonzero(known & (target != "jig")):
        raise file.error(
            int(row), "qw", f"an orientation of the target {target[row]!r}", "only the jig has one; empty it"
        )
    filled = file.cells.copy()  # the unknown ones: anything that passes the checks, NaN in the end
    for column in cells:
        filled.loc[~known, column] = "1" if column in ("qw", "rxx_rad2", "ryy_rad2", "rzz_rad2") else "0"
    file = TableFile(file.path, filled)
    quaternion = file.numbers(list(QUATERNION_COLUMNS))
    length = np.linalg.norm(quaternion, axis=1)
    for row in np.flatnonzero(np.abs(length - 1.0) > 1e-3):
        raise file.error(
            int(row),
            "qw ... qz",
            f"a quaternion of length {length[row]:.4g}",
            "give a unit quaternion, qw first",
        )
    scanner_R_jig = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]).as_matrix()
    scanner_R_jig[~known] = np.nan
    turn = None
    if _any(file, TURN_COLUMNS):
        limits = (_LEAST_OF_A_POINT * np.radians(LEAST_SIGMA_DEG), np.radians(MOST_SIGMA_DEG))
        turn = _load_covariance(file, TURN_COLUMNS, "rad", limits)
    cross = None
    if _any(file, CROSS_COLUMNS):
        file.require((*CROSS_COLUMNS, *COVARIANCE_COLUMNS, *TURN_COLUMNS))
        assert covariance_mm2 is not None
        assert turn is not None
        cross = file.numbers(list(CROSS_COLUMNS)).reshape(-1, 3, 3)
        whole = np.block([[covariance_mm2, cross], [np.swapaxes(cross, 1, 2), turn]])
        _check_positive(
            file, whole, "sxx_mm2 ... z_rz_mm_rad", "all 21 columns together are one covariance in mm and rad"
        )
    return Orientations(scanner_R_jig, turn, cross)


def points_frame(poses: Poses, points: Points) -> pd.DataFrame:
    """points.csv as a table."""
    columns: dict[str, Any] = {"pose": [poses.ids[i] for i in points.pose]}
    if np.any(points.target != "jig"):
        columns["target"] = points.target
    columns |= {f"{axis}_mm": points.xyz_mm[:, k] for k, axis in enumerate("xyz")}
    if points.covariance_mm2 is not None:
        upper = points.covariance_mm2[:, _UPPER[0], _UPPER[1]]
        columns |= {name: upper[:, k] for k, name in enumerate(COVARIANCE_COLUMNS)}
    if points.orientations is not None:
        columns |= _orientation_columns(points.orientations)
    return pd.DataFrame(columns)


def _orientation_columns(orientations: Orientations) -> dict[str, Array]:
    """Their columns; NaN, an empty cell, where the orientation is not known."""
    known = orientations.known

    def column(values: Array) -> Array:
        return np.where(known, values, np.nan)

    matrices = np.where(known[:, None, None], orientations.scanner_R_jig, np.eye(3))
    quaternion = Rotation.from_matrix(matrices).as_quat(canonical=True)[:, [3, 0, 1, 2]]
    columns = {name: column(quaternion[:, k]) for k, name in enumerate(QUATERNION_COLUMNS)}
    if orientations.covariance_rad2 is not None:
        upper = orientations.covariance_rad2[:, _UPPER[0], _UPPER[1]]
        columns |= {name: column(upper[:, k]) for k, name in enumerate(TURN_COLUMNS)}
    if orientations.cross_mm_rad is not None:
        cross = orientations.cross_mm_rad.reshape(-1, 9)
        columns |= {name: column(cross[:, k]) for k, name in enumerate(CROSS_COLUMNS)}
    return columns
