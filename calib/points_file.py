"""points.csv, read, checked and written: measured points in the scanner's frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calib.dataset import Points, Poses
from calib.errors import DatasetError
from calib.robot import Robot
from calib.table_file import TableFile

COVARIANCE_COLUMNS = ("sxx_mm2", "sxy_mm2", "sxz_mm2", "syy_mm2", "syz_mm2", "szz_mm2")
_UPPER = np.triu_indices(3)


def load_points(path: Path, robot: Robot, poses: Poses) -> tuple[Points, list[str]]:
    """The points, and what is odd about them yet possible. Raises DatasetError."""
    file = TableFile.load(path)
    file.require(["pose", "x_mm", "y_mm", "z_mm"])
    ids = file.text("pose")
    index = {pose_id: i for i, pose_id in enumerate(poses.ids)}
    for row, pose_id in enumerate(ids):
        if pose_id not in index:
            raise file.error(
                row, "pose", f"{pose_id!r} is not in poses.csv", "remove the row or add the pose"
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
            raise file.error(row, "target", f"found {name!r}", f"robot.toml knows {', '.join(known_targets)}")
    warnings = []
    extent_mm = float(np.ptp(xyz_mm, axis=0).max())
    if len(poses) > 1 and 0.0 < extent_mm < 5.0 and np.ptp(poses.q, axis=0).max() > 0.2:
        warnings.append(
            f"{path}: all points lie within {extent_mm:.3g} mm; columns are mm, these look like metres"
        )
    covariance = _load_covariance(file) if any(c in file for c in COVARIANCE_COLUMNS) else None
    pose = np.array([index[pose_id] for pose_id in ids], dtype=np.int64)
    return Points(pose, xyz_mm, target, covariance), warnings


def _load_covariance(file: TableFile) -> NDArray[np.float64]:
    file.require(COVARIANCE_COLUMNS)
    values = file.numbers(list(COVARIANCE_COLUMNS))
    covariance = np.zeros((len(values), 3, 3))
    covariance[:, _UPPER[0], _UPPER[1]] = values
    covariance[:, _UPPER[1], _UPPER[0]] = values
    bad = np.flatnonzero(np.linalg.eigvalsh(covariance)[:, 0] <= 0.0)
    if len(bad):
        raise file.error(
            int(bad[0]),
            "sxx_mm2 ... szz_mm2",
            "the covariance is not positive definite",
            "give a covariance in mm^2",
        )
    return covariance


def points_frame(poses: Poses, points: Points) -> pd.DataFrame:
    """points.csv as a table."""
    columns: dict[str, Any] = {"pose": [poses.ids[i] for i in points.pose]}
    if np.any(points.target != "jig"):
        columns["target"] = points.target
    columns |= {f"{axis}_mm": points.xyz_mm[:, k] for k, axis in enumerate("xyz")}
    if points.covariance_mm2 is not None:
        upper = points.covariance_mm2[:, _UPPER[0], _UPPER[1]]
        columns |= {name: upper[:, k] for k, name in enumerate(COVARIANCE_COLUMNS)}
    return pd.DataFrame(columns)
