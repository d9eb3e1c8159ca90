"""points.csv, read, checked and written: measured points in the scanner's frame, with orientations where known.

Optional columns of a full pose: `qw, qx, qy, qz`, the unit quaternion of scanner_R_jig (all four empty where it is
not known); the covariance of its error as a small turn about the scanner's axes, `rxx_rad2, rxy_rad2, rxz_rad2,
ryy_rad2, ryz_rad2, rzz_rad2`; and that of the point's error with the turn's, `x_rx_mm_rad, x_ry_mm_rad ...
z_rz_mm_rad`. Columns in metres have `m` in place of `mm` in their names, all of them. `shared1_x_mm ...
shared1_rz_rad`, `shared2_x_mm ...` are the changes of point and turn by one sigma of each error that all points
share, such as a lens's. `counts_as` is the number of usual measurements that a point weighs as much as, such as a mean
of fewer readings than the others. A row whose three coordinates are empty says that the point was not seen. In place of
x, y and z there may be `length_mm`, from an `anchor` whose place is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.array_types import Array, IndexArray
from calib.dataset.dataset import Orientations, Points, Poses
from calib.dataset.files.csv_table import TableFile, short
from calib.dataset.files.declared_units import (
    NOT_DECLARED,
    QUATERNION_COLUMNS,
    QUATERNION_ORDERS,
    DeclaredUnits,
    quaternion_order,
    unit_of,
)
from calib.dataset.files.points_checks import copied_rows, order_doubt, require_targets, unit_doubt
from calib.dataset.lengths import length_points
from calib.errors import DatasetError
from calib.frames import quaternion_from_rotation, rotation_from_quaternion
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.text_files.csv_text import as_number

COVARIANCE_COLUMNS = ("sxx_mm2", "sxy_mm2", "sxz_mm2", "syy_mm2", "syz_mm2", "szz_mm2")
TURN_COLUMNS = ("rxx_rad2", "rxy_rad2", "rxz_rad2", "ryy_rad2", "ryz_rad2", "rzz_rad2")
CROSS_COLUMNS = tuple(f"{point}_r{turn}_mm_rad" for point in "xyz" for turn in "xyz")
SHARED_PARTS = ("x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad")
_XYZ_COLUMNS = ("x_mm", "y_mm", "z_mm")
LENGTH_COLUMN = "length_mm"
COUNTS_AS = "counts_as"
_IN_MM = {"mm": 1.0, "m": 1000.0}
_UPPER = np.triu_indices(3)
FARTHEST_MM = 1e9
LEAST_SIGMA_MM, MOST_SIGMA_MM = 1e-6, 1e3  # as declared for an instrument; none is better or worse than that
LEAST_SIGMA_DEG, MOST_SIGMA_DEG = 1e-6, 90.0
_LEAST_OF_A_POINT = 0.01  # times those: corners of scans without noise are known as well as rounding lets them
_LEAST_EIGENVALUE = 1e-12  # of a covariance scaled to a unit diagonal: below it lies rounding


def load_points(
    path: Path, robot: Robot, poses: Poses, units: DeclaredUnits = NOT_DECLARED
) -> tuple[Points, list[str]]:
    """The measured points, and warnings about suspicious values. Raises DatasetError."""
    return _points_of(TableFile.load(path), robot, poses, units)


@dataclass(frozen=True)
class ArrivedPoints:
    """Points of a table that is still being written, with the poses whose row has no point or no pose yet."""

    points: Points
    unseen: tuple[str, ...]  # poses with a row whose coordinates are empty: the instrument saw nothing
    unknown: tuple[str, ...]  # names that poses.csv does not have (yet)


def load_arrived_points(
    path: Path, robot: Robot, poses: Poses, units: DeclaredUnits = NOT_DECLARED, *, growing: bool = False
) -> ArrivedPoints:
    """Points that have arrived so far: none where the file does not exist yet. Raises DatasetError.

    Of a `growing` file whole lines are read. Rows of poses that poses.csv does not have yet wait for them.
    """
    none = ArrivedPoints(Points(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros(0, dtype=np.str_)), (), ())
    if not path.exists() or path.stat().st_size == 0:
        return none
    file = TableFile.load(path, growing=growing)
    if not len(file):
        return none
    file.require(["pose"])
    ids = file.text("pose")
    known = file.select([row for row, pose_id in enumerate(ids) if pose_id in poses.ids])
    unknown = tuple(dict.fromkeys(pose_id for pose_id in ids if pose_id not in poses.ids))
    seen = _seen(known, _xyz_columns(known, units))
    unseen = tuple(dict.fromkeys(i for i in known.text("pose") if i not in set(seen.text("pose"))))
    points = _points_of(seen, robot, poses, units)[0] if len(seen) else none.points
    return ArrivedPoints(points, unseen, unknown)


def _xyz_columns(file: TableFile, units: DeclaredUnits) -> tuple[str, ...]:
    """Names of the three coordinates' columns, in mm or in m. Raises DatasetError where one is missing."""
    columns = _in_length(_XYZ_COLUMNS, unit_of(file, {u: _in_length(_XYZ_COLUMNS, u) for u in _IN_MM}, units.length))
    file.require(["pose", *columns])
    return columns


def _points_of(file: TableFile, robot: Robot, poses: Poses, units: DeclaredUnits) -> tuple[Points, list[str]]:
    """Points of a table's rows that have coordinates, and warnings. Raises DatasetError."""
    path = file.path
    if LENGTH_COLUMN in file:
        return _lengths_of(file, robot, poses), []
    xyz_columns = _xyz_columns(file, units)
    unit = xyz_columns[0].rpartition("_")[2]
    _refuse_mixed(file, unit)
    file = _seen(file, xyz_columns)
    if len(file) == 0:
        raise DatasetError(f"{path}: no row with a point; one row a measured point is needed")
    pose, target = _measured_of(file, robot, poses)
    xyz_mm = file.numbers(list(xyz_columns)) * _IN_MM[unit]
    _check_size(file, xyz_mm, xyz_columns)
    covariance = None
    covariance_columns = _in_length(COVARIANCE_COLUMNS, unit)
    if _any(file, covariance_columns):
        limits = (_LEAST_OF_A_POINT * LEAST_SIGMA_MM, MOST_SIGMA_MM)
        covariance = _load_covariance(file, covariance_columns, unit, limits, _IN_MM[unit])
    orientations = None
    if _any(file, (*QUATERNION_COLUMNS, *TURN_COLUMNS, *_in_length(CROSS_COLUMNS, unit))):
        orientations = _load_orientations(file, target, covariance, unit, units.quaternion)
    counts_as = None
    if COUNTS_AS in file:
        counts_as = file.numbers([COUNTS_AS])[:, 0]
        for row in np.flatnonzero(~(counts_as > 0.0))[:1]:
            raise file.error(int(row), COUNTS_AS, f"found {counts_as[row]:g}", "a number above 0 is needed")
    shared = _load_shared(file, orientations)
    points = Points(pose, xyz_mm, target, covariance, orientations, counts_as, shared=shared)
    return points, _warnings(file, robot, poses, points, unit)


def _lengths_of(file: TableFile, robot: Robot, poses: Poses) -> Points:
    """Lengths of a table's rows: pose, length_mm, and optionally anchor and target. Raises DatasetError."""
    if any(column in file for column in (*_XYZ_COLUMNS, *_in_length(_XYZ_COLUMNS, "m"))):
        raise DatasetError(f"{file.path}: line 1: found x_mm and {LENGTH_COLUMN}; a table holds points or lengths")
    if robot.carries_scanner:
        raise DatasetError(f'{file.path}: lengths are of a target on the arm; [scanner] mount = "flange" has none')
    file.require(["pose", LENGTH_COLUMN])
    file = file.select([row for row, cell in enumerate(file.text(LENGTH_COLUMN, allow_empty=True)) if cell])
    if len(file) == 0:
        raise DatasetError(f"{file.path}: no row with a length; one row a measured length is needed")
    pose, target = _measured_of(file, robot, poses)
    length_mm = file.numbers([LENGTH_COLUMN])[:, 0]
    for row in np.flatnonzero((length_mm <= 0.0) | (length_mm > FARTHEST_MM))[:1]:
        raise file.error(int(row), LENGTH_COLUMN, f"found {length_mm[row]:g}", "a length above 0, in mm, is needed")
    anchor = np.array(file.text("anchor", allow_empty=True) if "anchor" in file else [""] * len(file))
    try:
        return length_points(robot, poses, pose, target, length_mm, anchor)
    except DatasetError as error:
        raise DatasetError(f"{file.path}: {error}") from None


def _measured_of(file: TableFile, robot: Robot, poses: Poses) -> tuple[IndexArray, NDArray[np.str_]]:
    """Index of each row's pose, and its target. Raises DatasetError where there is no such pose or target."""
    index = {pose_id: i for i, pose_id in enumerate(poses.ids)}
    ids = file.text("pose")
    for row, pose_id in enumerate(ids):
        if pose_id not in index:
            raise file.error(row, "pose", f"{short(pose_id)} is not in poses.csv", "remove the row or add the pose")
    target = file.text("target") if "target" in file else ["jig"] * len(file)
    require_targets(file, target, robot)
    return np.array([index[pose_id] for pose_id in ids], dtype=np.int64), np.array(target)


def _in_length(columns: Sequence[str], unit: str) -> tuple[str, ...]:
    """Names of columns with mm replaced by another unit of length."""
    return tuple(name.replace("_mm", f"_{unit}") for name in columns)


def _refuse_mixed(file: TableFile, unit: str) -> None:
    """Raise DatasetError where points and covariances have different units of length."""
    other = "m" if unit == "mm" else "mm"
    for columns in (COVARIANCE_COLUMNS, CROSS_COLUMNS):
        if _any(file, _in_length(columns, other)) and not _any(file, _in_length(columns, unit)):
            wrong = next(name for name in _in_length(columns, other) if name in file)
            raise DatasetError(
                f"{file.path}: line 1: found x_{unit} and {wrong}; give all of them in one unit, mm or m"
            )


def _seen(file: TableFile, xyz_columns: Sequence[str]) -> TableFile:
    """The table without the rows whose three coordinates are empty or nan."""
    cells = [file.text(name, allow_empty=True) for name in xyz_columns]
    kept = [
        row
        for row, values in enumerate(zip(*cells, strict=True))
        if any(value.lower() not in ("", "nan") for value in values)
    ]
    return file if len(kept) == len(file) else file.select(kept)


def _check_size(file: TableFile, xyz_mm: Array, columns: Sequence[str]) -> None:
    """Raise DatasetError where a coordinate is farther away than `FARTHEST_MM`."""
    beyond = np.argwhere(np.abs(xyz_mm) > FARTHEST_MM)
    if len(beyond):
        row, axis = map(int, beyond[0])
        found = f"found {xyz_mm[row, axis]:g} mm, beyond {FARTHEST_MM / 1e6:g} km"
        raise file.error(row, columns[axis], found, "correct it or remove the row")


def _warnings(file: TableFile, robot: Robot, poses: Poses, points: Points, unit: str) -> list[str]:
    """Warnings about values that are possible but probably mistakes."""
    warnings = []
    doubt = unit_doubt(robot, poses, points, unit)
    extent_mm = float(np.ptp(points.xyz_mm, axis=0).max())
    if unit == "mm" and not doubt and len(poses) > 1 and 0.0 < extent_mm < 5.0 and np.ptp(poses.q, axis=0).max() > 0.2:
        doubt = f"all points lie within {extent_mm:.3g} mm; columns are mm, these look like metres"
    if doubt:
        warnings.append(f"{file.path}: {doubt}")
    turned = order_doubt(robot, poses, points, _by_order(file)) if points.orientations is not None else ""
    if turned:
        warnings.append(f"{file.path}: {turned}")
    copies = copied_rows(poses, points)
    if copies:
        earlier, row = copies[0]
        more = f" and {len(copies) - 1} more rows do alike" if len(copies) > 1 else ""
        warnings.append(
            f"{file.path}: line {file.line(row)} has the coordinates of line {file.line(earlier)} to the last digit"
            f"{more}; a second measurement differs: a copied row counts once and is no repeat, remove it"
        )
    return warnings


def _any(file: TableFile, columns: Sequence[str]) -> bool:
    return any(column in file for column in columns)


def _load_covariance(
    file: TableFile, columns: tuple[str, ...], unit: str, limits: tuple[float, float], scale: float = 1.0
) -> Array:
    """Covariances (M, 3, 3), mm^2 or rad^2, from the six columns of the upper triangle; `scale` converts to mm.

    Raises DatasetError where a sigma in some direction is outside the limits, mm or rad.
    """
    file.require(columns)
    values = file.numbers(list(columns)) * scale**2
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
            f"found a sigma of {sigma[row, end] / scale:.3g} {unit} in one direction",
            f"a sigma lies between {limits[0] / scale:.4g} and {limits[1] / scale:.4g} {unit}; give a covariance in "
            f"{unit}^2",
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
    file: TableFile, target: NDArray[np.str_], covariance_mm2: Array | None, unit: str, declared_order: str
) -> Orientations:
    file.require(QUATERNION_COLUMNS)
    order = quaternion_order(file, declared_order)
    cross_columns = _in_length(CROSS_COLUMNS, unit)
    more = [c for c in (*TURN_COLUMNS, *cross_columns) if c in file]
    cells = {c: file.text(c, allow_empty=True) for c in (*QUATERNION_COLUMNS, *more)}
    known = np.array([any(cells[c][row] for c in QUATERNION_COLUMNS) for row in range(len(file))], dtype=bool)
    for row in np.flatnonzero(known & (target != "jig")):
        raise file.error(
            int(row), "qw", f"an orientation of the target {target[row]!r}", "only the jig has one; empty it"
        )
    any_value = dict.fromkeys((order[0], "rxx_rad2", "ryy_rad2", "rzz_rad2"), "1")  # that passes; NaN in the end
    filled = {
        column: [cell if there else any_value.get(column, "0") for cell, there in zip(texts, known, strict=True)]
        for column, texts in cells.items()
    }
    file = replace(file, cells=file.cells | filled)
    quaternion = file.numbers(list(order))
    length = np.linalg.norm(quaternion, axis=1)
    for row in np.flatnonzero(np.abs(length - 1.0) > 1e-3):
        raise file.error(
            int(row), "qw ... qz", f"a quaternion of length {length[row]:.4g}", "give a unit quaternion, qw first"
        )
    scanner_R_jig = rotation_from_quaternion(quaternion)
    scanner_R_jig[~known] = np.nan
    turn = None
    if _any(file, TURN_COLUMNS):
        limits = (_LEAST_OF_A_POINT * np.radians(LEAST_SIGMA_DEG), np.radians(MOST_SIGMA_DEG))
        turn = _load_covariance(file, TURN_COLUMNS, "rad", limits)
    cross = None
    if _any(file, cross_columns):
        file.require((*cross_columns, *_in_length(COVARIANCE_COLUMNS, unit), *TURN_COLUMNS))
        assert covariance_mm2 is not None
        assert turn is not None
        cross = file.numbers(list(cross_columns)).reshape(-1, 3, 3) * _IN_MM[unit]
        whole = np.block([[covariance_mm2, cross], [np.swapaxes(cross, 1, 2), turn]])
        _check_positive(
            file,
            whole,
            f"sxx_{unit}2 ... z_rz_{unit}_rad",
            f"all 21 columns together are one covariance in {unit} and rad",
        )
    return Orientations(scanner_R_jig, turn, cross)


def shared_columns(number: int) -> tuple[str, ...]:
    """Names of the six columns of the k-th shared error, counted from 1."""
    return tuple(f"shared{number}_{part}" for part in SHARED_PARTS)


def _load_shared(file: TableFile, orientations: Orientations | None) -> Array | None:
    """Changes (M, 6, K), mm and rad, by one sigma of each error that all points share; None without such columns.

    Raises DatasetError where one of its columns is missing, or there are no orientations to which they belong.
    """
    count = 0
    while _any(file, shared_columns(count + 1)):
        count += 1
    if not count:
        return None
    file.require([name for k in range(count) for name in shared_columns(k + 1)])
    if orientations is None or not orientations.known.all():
        raise DatasetError(f"{file.path}: line 1: shared errors are of full poses; give qw, qx, qy, qz in every row")
    return np.stack([file.numbers(list(shared_columns(k + 1))) for k in range(count)], axis=-1)


def _by_order(file: TableFile) -> dict[str, Array]:
    """Orientations (M, 3, 3) from the four columns, by quaternion order "wxyz" and "xyzw"; NaN where not known."""
    columns = [name for name in file.cells if name in QUATERNION_COLUMNS]
    values = np.array([[as_number(cell) for cell in file.cells[name]] for name in columns], dtype=float).T
    known = np.isfinite(values).all(axis=1)
    filled = np.where(known[:, None], values, 1.0)
    turns = {
        order: rotation_from_quaternion(filled[:, [order.index(part) for part in "wxyz"]])
        for order in QUATERNION_ORDERS
    }
    return {order: np.where(known[:, None, None], turn, np.nan) for order, turn in turns.items()}


def points_frame(poses: Poses, points: Points) -> pd.DataFrame:
    """Table of points as they were measured, with the columns of points.csv."""
    points = points.free_of(None)
    columns: dict[str, Any] = {"pose": [poses.ids[i] for i in points.pose]}
    if np.any(points.target != "jig"):
        columns["target"] = points.target
    if points.lengths is not None:
        named = {"anchor": points.lengths.anchor} if np.any(points.lengths.anchor != "") else {}
        return pd.DataFrame(columns | named | {LENGTH_COLUMN: points.lengths.length_mm})
    columns |= {f"{axis}_mm": points.xyz_mm[:, k] for k, axis in enumerate("xyz")}
    if points.counts_as is not None:
        columns[COUNTS_AS] = points.counts_as
    if points.covariance_mm2 is not None:
        upper = points.covariance_mm2[:, _UPPER[0], _UPPER[1]]
        columns |= {name: upper[:, k] for k, name in enumerate(COVARIANCE_COLUMNS)}
    if points.orientations is not None:
        columns |= _orientation_columns(points.orientations)
    if points.shared is not None:
        for k in range(points.shared.shape[2]):
            columns |= {name: points.shared[:, part, k] for part, name in enumerate(shared_columns(k + 1))}
    return pd.DataFrame(columns)


def _orientation_columns(orientations: Orientations) -> dict[str, Array]:
    """Columns of points.csv that hold the orientations; NaN, an empty cell, where one is not known."""
    known = orientations.known

    def column(values: Array) -> Array:
        return np.where(known, values, np.nan)

    matrices = np.where(known[:, None, None], orientations.scanner_R_jig, np.eye(3))
    quaternion = quaternion_from_rotation(matrices)
    columns = {name: column(quaternion[:, k]) for k, name in enumerate(QUATERNION_COLUMNS)}
    if orientations.covariance_rad2 is not None:
        upper = orientations.covariance_rad2[:, _UPPER[0], _UPPER[1]]
        columns |= {name: column(upper[:, k]) for k, name in enumerate(TURN_COLUMNS)}
    if orientations.cross_mm_rad is not None:
        cross = orientations.cross_mm_rad.reshape(-1, 9)
        columns |= {name: column(cross[:, k]) for k, name in enumerate(CROSS_COLUMNS)}
    return columns
