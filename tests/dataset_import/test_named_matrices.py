"""Matrices of the flange's poses whose columns are named by row and column."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.dataset_import.flange_poses import readings_of
from calib.errors import CalibError
from calib.text_files.user_table import parse_table


@pytest.mark.parametrize(
    "names",
    [
        [f"m{i}{j}" for i in range(4) for j in range(4)],
        [f"T_{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3, 4)],
        [f"base_T_flange_{k}" for k in range(1, 17)],
        [*(f"R{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "tx", "ty", "tz"],
    ],
)
def test_a_matrix_is_read_by_the_names_of_its_columns(names: list[str]) -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :3, :3] = Rotation.random(5, random_state=1).as_matrix()
    poses[:, :3, 3] = np.random.default_rng(2).uniform(-600.0, 600.0, (5, 3))
    cells = poses if len(names) == 16 else poses[:, :3]
    parted = np.hstack([poses[:, :3, :3].reshape(5, 9), poses[:, :3, 3]])
    rows = parted if "tx" in names else cells.reshape(5, -1)
    order = np.random.default_rng(3).permutation(len(names))
    lines = [",".join(names[k] for k in order), *(",".join(map(repr, row[order].tolist())) for row in rows)]
    (reading,) = readings_of(parse_table(Path("t.csv"), "\n".join(lines)))
    assert reading.base_T_flange == pytest.approx(poses, abs=1e-9)


def test_numbers_that_are_no_attitude_are_told() -> None:
    lines = ["x,y,z,qw,qx,qy,qz", *(f"{k},0,0,2,0,0,{k}" for k in range(5))]
    with pytest.raises(CalibError, match=r"t\.csv: qw, qx, qy, qz are no unit quaternions"):
        readings_of(parse_table(Path("t.csv"), "\n".join(lines)))
