"""The controller's own poses beside the joints: whether it computes with the table that the user gave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib.consistency.own_pose import table_disagreement_mm
from calib.dataset.files.robot_toml import load_robot_toml
from calib.dataset_import.place_columns import own_pose_columns
from tests.support.recorded_run import ROWS, ZERO_DEG, robot_toml

NOMINAL = (0.0,) * len(ROWS)


def flange(q: np.ndarray, zero_deg: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Place and attitude of the last frame, by elementary rotations."""
    place, turn = np.zeros((len(q), 3)), Rotation.identity(len(q))
    for k, (a, alpha, d, theta) in enumerate(ROWS):
        turn = turn * Rotation.from_rotvec(np.outer(q[:, k] + np.radians(theta + zero_deg[k]), [0.0, 0.0, 1.0]))
        place = place + turn.apply([a, 0.0, d])
        turn = turn * Rotation.from_euler("x", np.radians(alpha))
    return place, turn.as_matrix()


def least_mm(q: np.ndarray, seen: np.ndarray) -> float:
    """Least rms distance of the nominal arm to places, over all base frames and tools, from many starts."""
    place, turn = flange(q, NOMINAL)

    def off(p: np.ndarray) -> np.ndarray:
        mine = place + turn @ (100.0 * p[6:])
        return np.asarray((Rotation.from_rotvec(p[:3]).apply(mine) + 1000.0 * p[3:6] - seen).ravel())

    rng = np.random.default_rng(0)
    fits = [least_squares(off, np.r_[rng.normal(0.0, 1.5, 3), np.zeros(6)]) for _ in range(6)]
    return float(np.sqrt(2.0 * min(fit.cost for fit in fits) / len(seen)))


@pytest.mark.parametrize("zero_deg", [NOMINAL, ZERO_DEG])
def test_the_distance_is_the_least_over_all_bases_and_tools(zero_deg: tuple[float, ...], tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(robot_toml())
    q = np.random.default_rng(4).uniform(-1.5, 1.5, (60, 6))
    place, turn = flange(q, zero_deg)
    base = Rotation.from_euler("xyz", [0.4, 2.7, -1.2])
    seen = base.apply(place + turn @ [5.0, 90.0, -30.0]) + np.array([500.0, 0.0, 90.0])
    mine = table_disagreement_mm(load_robot_toml(tmp_path / "robot.toml"), q, seen)
    if zero_deg == NOMINAL:
        assert mine < 1e-3
    else:
        assert 0.5 < mine < 10.0
        assert mine == pytest.approx(least_mm(q, seen), rel=1e-3)


def test_columns_of_the_controllers_tool_are_found() -> None:
    rtde = [f"{kind}_TCP_{what}_{k}" for kind in ("actual", "target") for what in ("pose", "speed") for k in range(6)]
    assert own_pose_columns(rtde) == ("actual_TCP_pose_0", "actual_TCP_pose_1", "actual_TCP_pose_2")
    assert own_pose_columns(["q1", "tcp_x", "tcp_y", "tcp_z", "tcp_rx"]) == ("tcp_x", "tcp_y", "tcp_z")
    assert own_pose_columns(["x", "y", "z", "laser_x", "laser_y", "laser_z"]) is None
