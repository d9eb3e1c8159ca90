"""Causes that MuJoCo puts into the measurements: springs in the joints under the links' weight, an uneven gear.

Nothing of the simulation in `calib` makes these data but the chain that the table makes: the engine weighs the arm, and
its springs come to rest by MuJoCo's own forces.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import diagnose
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot
from tests.support.mujoco_arm import in_mujoco, mujoco_model
from tests.support.sweeps import sweep

POSES, TRAIN = 80, 64
NOISE_MM = 0.05


def measured(
    arm: str,
    seed: int,
    *,
    compliance_rad_per_nm: float = 0.0,
    gear_rad: float = 0.0,
    masses: bool = True,
) -> Dataset:
    """What a scanner somewhere sees of an arm with link errors, the effects in its motions.

    Every joint is a spring of the given compliance, 30 % apart; joint 3's gear is off by gear_rad twice a turn.
    """
    rng = np.random.default_rng([31, seed])
    nominal = builtin_robot(arm)
    n = nominal.n_joints
    off = rng.normal(size=nominal.table.shape) * np.array([0.3, 1.7e-3, 0.3, 1.7e-3, 1.7e-3])
    true = nominal.with_table(nominal.table + off)
    q = random_poses(nominal, POSES, rng=rng)
    payload_kg = rng.choice([0.0, 3.0], POSES)
    compliance = compliance_rad_per_nm * np.exp(0.3 * rng.standard_normal(n))
    models = {kg: mujoco_model(true, kg) for kg in (0.0, 3.0)}
    xyz = np.empty((POSES, 3))
    for k in range(POSES):
        commanded = q[k].copy()
        commanded[2] += gear_rad * np.sin(2.0 * q[k, 2] + 0.7)
        xyz[k] = at_rest(models[payload_kg[k]], true, commanded, compliance)
    turn = Rotation.random(random_state=seed).as_matrix()
    seen_mm = (xyz - [300.0, -200.0, 500.0]) @ turn.T + rng.normal(scale=NOISE_MM, size=xyz.shape)
    role = np.array(["reference", *["train"] * (TRAIN - 1), *["test"] * (POSES - TRAIN)])
    poses = Poses(
        ids=tuple(f"p{k:02d}" for k in range(POSES)),
        role=role,
        q=q,
        setup=np.full(POSES, ""),
        payload_kg=payload_kg,
        scan_names=("",) * POSES,
    )
    points = Points(np.arange(POSES), seen_mm, np.full(POSES, "jig"))
    robot = nominal if masses else without_masses(nominal)
    return Dataset(
        folder=None, name=arm, description="", robot=robot, poses=poses, points=points, scan_folder=None,
        scanner=Scanner(point_sigma_mm=NOISE_MM),
    )  # fmt: skip


def at_rest(model: Any, robot: Robot, commanded: NDArray, compliance: NDArray) -> NDArray:
    """(3,) where the target hangs once springs and weights agree: q = commanded - c * what would hold the arm up."""
    q = commanded
    for _ in range(6):
        q = commanded - compliance * in_mujoco(model, robot, q).qfrc_bias
    return np.asarray(in_mujoco(model, robot, q).site("target").xpos * 1e3)


def without_masses(robot: Robot) -> Robot:
    """As most datasets come."""
    bare = tuple(replace(joint, mass_kg=None, com_mm=None) for joint in robot.joints)
    return replace(robot, joints=bare)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "masses"),
    sweep([("rb5", True), ("panda", True), ("panda", False)], every_run=[("panda", False)]),
)
def test_springs_in_the_joints_are_named(arm: str, masses: bool) -> None:
    result = diagnose(measured(arm, 1, compliance_rad_per_nm=1e-4, masses=masses))
    if masses:
        assert result.missing[:1] == ("joint_compliance",), result.summary()
    else:
        assert (result.missing, result.ambiguous_set[0]) == ((), "joint_compliance"), result.summary()
    before, after = result.steps[0].calibration.after.test, result.calibration.after.test
    assert after.rmse_mm < 0.6 * before.rmse_mm
    assert result.calibration.sigma_mm < 1.3 * NOISE_MM


@pytest.mark.thorough
def test_springs_and_an_uneven_gear_are_both_named() -> None:
    result = diagnose(measured("rb5", 2, compliance_rad_per_nm=1e-4, gear_rad=8e-4))
    assert set(result.missing) == {"joint_compliance", "transmission_error"}, result.summary()
    assert result.verdict == "named"


@pytest.mark.slow
@pytest.mark.parametrize("arm", sweep(["rb5", "panda"], every_run=["panda"]))
def test_a_stiff_arm_lacks_nothing(arm: str) -> None:
    result = diagnose(measured(arm, 3))
    assert result.verdict == "adequate", result.summary()
