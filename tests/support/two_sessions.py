"""The same arm measured twice by MuJoCo, from another place, at other poses, with one thing changed in between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.robot import Robot
from calib.simulation.simulate import simulate_dataset
from tests.support.mujoco_arm import in_mujoco, mujoco_model

LENGTH_MM, ANGLE_RAD = 0.3, np.radians(0.1)  # the arm's own errors


def measured_twice(
    seed: int,
    changed: dict[str, float] | None = None,
    *,
    robot: str = "rb5",
    poses: int = 64,
    noise_mm: float = 0.05,
    other_arm: bool = False,
) -> tuple[Dataset, Dataset]:
    """Two datasets of one arm with random link errors; `changed`: what each parameter gained in between.

    other_arm: the second is of another arm of the type, with link errors of its own.
    """
    rng = np.random.default_rng(seed)
    nominal = builtin_robot(robot)
    table = nominal.table + _errors(nominal, rng)
    moved = (nominal.table + _errors(nominal, rng) if other_arm else table).copy()
    for name, by in (changed or {}).items():
        moved[np.unravel_index(nominal.parameter_names.index(name), moved.shape)] += by
    one, other = (
        _measured(nominal, nominal.with_table(true), rng, poses, noise_mm, name)
        for true, name in ((table, "before"), (moved, "after"))
    )
    return one, other


def _errors(robot: Robot, rng: np.random.Generator) -> Array:
    size = np.array([LENGTH_MM, ANGLE_RAD, LENGTH_MM, ANGLE_RAD, ANGLE_RAD])
    return rng.normal(size=robot.table.shape) * size


def _measured(
    nominal: Robot, true: Robot, rng: np.random.Generator, poses: int, noise_mm: float, name: str
) -> Dataset:
    plan = simulate_dataset(nominal, rng=rng, poses=poses, noise_mm=noise_mm, name=name).dataset
    assert plan.points is not None
    model = mujoco_model(true)
    tool_mm = np.array(
        [1e3 * in_mujoco(model, true, q).site("target").xpos for q in plan.poses.q[plan.points.pose]]
    )
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    seen_mm = (tool_mm - tool_mm.mean(axis=0)) @ turn.T + [0.0, 0.0, 2500.0]
    noisy = seen_mm + noise_mm * rng.normal(size=seen_mm.shape)
    return plan.with_points(replace(plan.points, xyz_mm=noisy))
