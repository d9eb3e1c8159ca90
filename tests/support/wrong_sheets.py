"""Datasets whose tables are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.robot import Joint, Robot, Tool
from calib.simulation.simulate import simulate_dataset
from calib.simulation.truth.arm_sampling import Tolerances

HALF = 0.5 * np.pi


ARMS = {
    "rb5": builtin_robot("rb5"),
    "panda": builtin_robot("panda"),
    "scara": Robot(
        "scara",
        (
            Joint(325.0, 0.0, 0.0, 0.0, 0.0, name="J1"),
            Joint(275.0, np.pi, 0.0, 0.0, 0.0, name="J2"),
            Joint(0.0, 0.0, 0.0, 0.0, 0.0, name="J3", type="prismatic", min=0.0, max=210.0),
            Joint(0.0, 0.0, 0.0, 0.0, 0.0, name="J4"),
        ),
        Tool(40.0, 0.0, 50.0, 0.0, 0.0),
    ),
    "gantry": Robot(
        "gantry",
        (
            Joint(0.0, -HALF, 0.0, 0.0, 0.0, name="X", type="prismatic", min=0.0, max=900.0),
            Joint(0.0, HALF, 0.0, HALF, 0.0, name="Y", type="prismatic", min=0.0, max=700.0),
            Joint(0.0, 0.0, 0.0, 0.0, 0.0, name="Z", type="prismatic", min=0.0, max=400.0),
            Joint(0.0, HALF, 0.0, 0.0, 0.0, name="C"),
            Joint(0.0, 0.0, 100.0, 0.0, 0.0, name="A"),
        ),
        Tool(60.0, 0.0, 50.0, 0.0, 0.0),
    ),
}


def simulated(arm: str, seed: int = 0, *, poses: int = 40, effect: tuple[str, float] | None = None) -> Dataset:
    return simulate_dataset(
        ARMS[arm],
        rng=seed,
        poses=poses,
        effects=[effect] if effect else [],
        tolerances=Tolerances(0.5, 0.2),
    ).dataset


def with_joints(dataset: Dataset, q: np.ndarray) -> Dataset:
    return replace(dataset, poses=replace(dataset.poses, q=q, came_from=np.zeros((0, 0))))


def turned(dataset: Dataset, *joints: int) -> Dataset:
    signs = np.ones(dataset.robot.n_joints)
    signs[[joint - 1 for joint in joints]] = -1.0
    return with_joints(dataset, dataset.poses.q * signs)


def with_points(dataset: Dataset, scale: float) -> Dataset:
    return replace(dataset, points=replace(dataset.points, xyz_mm=scale * dataset.points.xyz_mm))
