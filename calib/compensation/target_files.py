"""Files of joint targets: reading of a robot program's table, writing of the corrected targets.

Columns are those of poses.csv, and only the joints are required. `pose` names a target, conditions (payload_kg,
temperature_c, time_s, approach1 ...) are for effects that depend on them, any other column may be for effects of the
user's own file; all columns are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.compensation.correction import Correction
from calib.dataset.dataset import Poses
from calib.dataset.files.csv_table import TableFile
from calib.dataset.files.declared_units import internal
from calib.dataset.files.poses_csv import (
    approach_columns,
    found_joint_columns,
    in_unit_of,
    joint_columns,
    load_conditions,
    load_joints,
    names,
)
from calib.dataset.input_names import CONDITIONS
from calib.errors import DatasetError
from calib.kinematics.robot import Robot
from calib.lazy_modules import pd
from calib.text_files.csv_text import frame_csv
from calib.text_files.toml_table import degrees


@dataclass(frozen=True)
class Targets:
    """Joint targets as poses, with the path of the file that they come from."""

    poses: Poses
    file: TableFile


def load_targets(path: Path, robot: Robot) -> Targets:
    """Joint targets for a robot, read from a table. Raises DatasetError, naming line and column."""
    if path.is_dir():
        raise DatasetError(f"{path}: is a folder; name a table of joint targets")
    if not path.exists():
        raise DatasetError(f"{path}: no such file; a table with the columns {', '.join(joint_columns(robot))}")
    file = TableFile.load(path, pipe=True)
    columns = found_joint_columns(file, robot)
    file.require(columns)
    if len(file) == 0:
        raise DatasetError(f"{path}: no row below the header; one row a target is needed")
    ids = names(file, "pose") if "pose" in file else [str(i + 1) for i in range(len(file))]
    poses = Poses(
        ids=tuple(ids),
        role=np.full(len(file), "train"),
        q=robot.joints_of(internal(load_joints(file, columns), columns)),
        setup=np.full(len(file), ""),
        scan_names=("",) * len(file),
        extra=file.rest(["pose", *columns, *CONDITIONS, *approach_columns(robot)]),
        selected_from=None,
        **load_conditions(file, robot),
    )
    return Targets(poses.measured_later(), file)


def require_conditions(targets: Targets, needed: Sequence[str], families: Sequence[str]) -> None:
    """Raise DatasetError where the table lacks a column that the calibrated arm depends on.

    Args:
        targets: the targets as they were read.
        needed: columns that `calib.compensation.target_correction.needed_columns` returns.
        families: names of the model's effects.
    """
    missing = [column for column in needed if column not in targets.file]
    if missing:
        raise DatasetError(
            f"{targets.file.path}: line 1: missing column {', '.join(missing)}; the calibrated arm depends on it "
            f"through its effects ({', '.join(families)}), so give it for each target, as poses.csv does"
        )


def corrected_table(targets: Targets, correction: Correction) -> str:
    """The table with corrected joints as CSV text; `reached` is false for missed targets, whose joints are empty."""
    robot = correction.robot
    cells = dict(targets.file.cells)
    commanded = robot.commands_of(correction.q)
    for k, column in enumerate(found_joint_columns(targets.file, robot)):
        q = commanded[:, k]
        cells[column] = [
            repr(degrees(v) if column.endswith("_deg") else in_unit_of(column, float(v))) if reached else ""
            for v, reached in zip(q, correction.reached, strict=True)
        ]
    cells["reached"] = ["true" if reached else "false" for reached in correction.reached]
    return frame_csv(pd.DataFrame(cells))
