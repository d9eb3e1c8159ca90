"""An arm in MuJoCo whose joints give way, with the signals that its controller writes down, as a dataset's folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.robot import PARAMETER_KINDS, Robot
from tests.support.mujoco_arm import in_mujoco, mujoco_model

COMPLIANCE = {1: 6e-5, 2: 9e-5}  # rad/Nm, by joint counted from 0
_REACH_RAD = np.array([2.6, 1.2, 1.9, 2.4, 2.0, 2.6])


@dataclass(frozen=True)
class Measured:
    """N poses of the arm: joints as commanded, as the links stand, gravity's torques and points in its base frame."""

    robot: Robot  # as delivered, with its masses
    q: NDArray  # (N, n) rad
    link_q: NDArray  # (N, n) rad
    torque_nm: NDArray  # (N, n) of gravity
    point_mm: NDArray  # (N, 3)


def weightless(robot: Robot) -> Robot:
    """The arm without any mass in its table."""
    joints = tuple(replace(joint, mass_kg=None, com_mm=None) for joint in robot.joints)
    return replace(robot, joints=joints, tool=replace(robot.tool, mass_kg=None, com_mm=None))


def measured(
    poses: int = 70,
    seed: int = 1,
    payload_kg: NDArray | None = None,
    further: NDArray | None = None,
    growth: NDArray | None = None,
) -> Measured:
    """An RB5 with a table a little off, whose joints yield to gravity: each pose by itself, in equilibrium.

    `further` (N, n) rad is what else turns the links, `growth` (N,) the factor of all lengths. The payload hangs at
    60 mm from the flange.
    """
    rng = np.random.default_rng(seed)
    robot = builtin_robot("rb5")
    robot = replace(robot, tool=replace(robot.tool, payload_com_mm=(10.0, 5.0, 60.0)))
    off = rng.normal(size=robot.table.shape) * [0.3 if kind in "ad" else 5e-4 for kind in PARAMETER_KINDS]
    arm = robot.with_table(robot.table + off)
    q = rng.uniform(-1.0, 1.0, (poses, robot.n_joints)) * _REACH_RAD
    payload_kg = np.zeros(poses) if payload_kg is None else payload_kg
    models = {kg: mujoco_model(arm, kg) for kg in np.unique(payload_kg).tolist()}
    link_q, torque_nm, point_mm = q.copy(), np.zeros_like(q), np.zeros((poses, 3))
    for i, kg in enumerate(payload_kg.tolist()):
        if growth is not None:
            longer = [growth[i] if kind in "ad" else 1.0 for kind in PARAMETER_KINDS]
            models[kg] = mujoco_model(arm.with_table(arm.table * longer), kg)
        for _ in range(6):
            data = in_mujoco(models[kg], arm, link_q[i])
            torque_nm[i] = -data.qfrc_bias
            link_q[i] = q[i] if further is None else q[i] + further[i]
            for joint, soft in COMPLIANCE.items():
                link_q[i, joint] += soft * torque_nm[i, joint]
        point_mm[i] = 1e3 * in_mujoco(models[kg], arm, link_q[i]).site("target").xpos
    return Measured(robot, q, link_q, torque_nm, point_mm)


def write(
    folder: Path, cell: Measured, columns: Mapping[str, NDArray], noise_mm: float = 0.03, *, masses: bool = False
) -> Dataset:
    """The dataset, written with further columns of poses.csv and read again; one pose in five is for the test."""
    n = len(cell.q)
    rng = np.random.default_rng(17)
    ids = tuple(f"P{i:03d}" for i in range(n))
    role = np.array(["reference", *("test" if i % 5 == 4 else "train" for i in range(1, n))])
    turn = Rotation.from_rotvec([0.3, -0.2, 1.1]).as_matrix()
    seen_mm = cell.point_mm @ turn.T + [400.0, -900.0, 250.0] + noise_mm * rng.normal(size=(n, 3))
    poses = Poses(ids, role, cell.q, np.full(n, ""), tuple(f"{name}.ply" for name in ids))
    poses = replace(poses, **{k: v for k, v in columns.items() if k == "payload_kg"})
    poses = replace(poses, extra=pd.DataFrame({k: v for k, v in columns.items() if k != "payload_kg"}))
    dataset = Dataset(
        name="signals",
        robot=cell.robot if masses else weightless(cell.robot),
        poses=poses,
        points=Points(np.arange(n), seen_mm, np.full(n, "jig")),
        scanner=Scanner(point_sigma_mm=noise_mm),
        jig_is_declared=False,
    )
    write_dataset(dataset, folder)
    return load_dataset(folder)
