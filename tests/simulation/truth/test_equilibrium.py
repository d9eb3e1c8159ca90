"""The simulated truth: held against calib.kinematics.chain, against MuJoCo, and against the laws it claims."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.kinematics.chain import forward
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Joint, Robot, Tool
from calib.simulation.truth.equilibrium import Truth, solve_equilibrium
from calib.simulation.truth.joint_effects import TransmissionError
from calib.simulation.truth.load_effects import JointCompliance
from calib.simulation.truth.mechanism import Arm, Conditions
from tests.support.mujoco_arm import frames, in_mujoco, mujoco_model

ARMS = ("rb5", "panda")


def gravity_torques(robot: Robot, q: NDArray, payload_kg: NDArray | None = None) -> NDArray:
    return Arm.commanded_to(robot, q, Conditions(payload_kg=payload_kg)).gravity_torques


def crooked(robot: Robot, rng: np.random.Generator) -> Robot:
    """The robot with errors in all its parameters, beta too."""
    return robot.with_table(robot.table + rng.normal(0.0, 0.05, robot.table.shape))


def slider() -> Robot:
    """Two turning joints with a sliding one between them."""
    return Robot(
        name="slider",
        joints=(
            Joint(a_mm=100.0, alpha_rad=1.2, d_mm=200.0, mass_kg=2.0, com_mm=(10.0, 20.0, 30.0)),
            Joint(
                a_mm=10.0,
                alpha_rad=-0.7,
                beta_rad=0.1,
                type="prismatic",
                min=0.0,
                max=300.0,
                mass_kg=1.5,
                com_mm=(0, 5.0, 0),
            ),
            Joint(a_mm=50.0, d_mm=20.0, theta_rad=0.3, mass_kg=1.0, com_mm=(-20.0, 0.0, 4.0)),
        ),
        tool=Tool(a_mm=5.0, d_mm=70.0, mass_kg=0.4, com_mm=(0.0, 0.0, 30.0), payload_com_mm=(1.0, 2.0, 80.0)),
        gravity_m_s2=(0.5, -2.0, -9.5),
    )


@pytest.mark.parametrize("robot", [builtin_robot("rb5"), builtin_robot("panda"), slider()], ids=lambda r: r.name)
def test_elementary_chain_is_the_multiplied_out_chain(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    robot = crooked(robot, rng)
    q = random_poses(robot, 20, rng=rng)
    np.testing.assert_allclose(
        np.stack(frames(robot, q), axis=1),
        forward(robot.table, q, robot.is_revolute).base_T_frame,
        atol=1e-10,
    )


@pytest.mark.parametrize("payload_kg", [0.0, 3.0])
@pytest.mark.parametrize("robot", [builtin_robot("rb5"), builtin_robot("panda"), slider()], ids=lambda r: r.name)
def test_chain_and_gravity_torques_agree_with_mujoco(robot: Robot, payload_kg: float) -> None:
    rng = np.random.default_rng(2)
    robot = crooked(robot, rng)
    model = mujoco_model(robot, payload_kg)
    q = random_poses(robot, 12, rng=rng)
    torque, target_mm = gravity_torques(robot, q, np.full(12, payload_kg)), frames(robot, q)[-1][:, :3, 3]
    assert np.abs(torque).max() > 1.0
    for k in range(12):
        data = in_mujoco(model, robot, q[k])
        np.testing.assert_allclose(data.site("target").xpos * 1e3, target_mm[k], atol=1e-9)
        np.testing.assert_allclose(torque[k], -data.qfrc_bias, atol=1e-9)  # at rest the bias is what holds the arm up


def soft(robot: Robot, scale: float = 1.0) -> Truth:
    truth = Truth.without_effects(robot, np.eye(4))
    compliance = scale * 1e-4 * np.linspace(0.5, 2.0, robot.n_joints) * robot.is_revolute
    return truth.with_effects(JointCompliance(compliance))


def compliance_of(truth: Truth) -> NDArray:
    (effect,) = truth.effects
    assert isinstance(effect, JointCompliance)
    return effect.c_rad_per_nm


@pytest.mark.parametrize("payload_kg", [0.0, 3.0])
@pytest.mark.parametrize("arm", ARMS)
def test_mujoco_joint_springs_are_at_rest_where_the_arm_settles(arm: str, payload_kg: float) -> None:
    robot = builtin_robot(arm)
    truth = soft(robot, 3.0)
    model = mujoco_model(robot, payload_kg)
    q = random_poses(robot, 6, rng=np.random.default_rng(3))
    settled = solve_equilibrium(truth, q, Conditions(payload_kg=np.full(6, payload_kg))).q
    model.jnt_stiffness[:] = 1.0 / compliance_of(truth)
    for k in range(len(q)):
        model.qpos_spring[:] = q[k]
        data = in_mujoco(model, robot, settled[k])
        assert np.abs(data.qfrc_bias).max() > 1.0
        np.testing.assert_allclose(data.qfrc_passive, data.qfrc_bias, atol=1e-8)


@pytest.mark.parametrize("robot", [builtin_robot("rb5"), builtin_robot("panda"), slider()], ids=lambda r: r.name)
def test_equilibrium_law(robot: Robot) -> None:
    """Deflection = compliance x torque at the deflected pose, and that torque is not the one at the commanded pose."""
    truth = soft(robot, 5.0)
    q = random_poses(robot, 10, rng=np.random.default_rng(4))
    payload_kg = np.linspace(0.0, 4.0, 10)
    settled = solve_equilibrium(truth, q, Conditions(payload_kg=payload_kg)).q
    compliance = compliance_of(truth)
    np.testing.assert_allclose(settled - q, compliance * gravity_torques(robot, settled, payload_kg), atol=1e-13)
    assert np.abs(settled - q - compliance * gravity_torques(robot, q, payload_kg)).max() > 1e-7


def test_pendulum_hangs_where_a_scalar_equation_says() -> None:
    """A horizontal axis, a mass m at radius r: theta = q - c m g r cos(theta)."""
    c, m, r_mm = 0.05, 2.0, 400.0
    joints = (Joint(a_mm=500.0, mass_kg=m, com_mm=(r_mm - 500.0, 0.0, 0.0)),)
    robot = Robot(name="pendulum", joints=joints, gravity_m_s2=(0.0, -9.81, 0.0))
    truth = Truth.without_effects(robot, np.eye(4)).with_effects(JointCompliance(np.array([c])))
    for q in (-1.0, 0.2, 1.4):
        wanted = brentq(lambda theta, q=q: theta - q + c * m * 9.81 * r_mm / 1e3 * np.cos(theta), -5.0, 5.0, xtol=1e-14)
        assert solve_equilibrium(truth, np.array([[q]])).q[0, 0] == pytest.approx(wanted, abs=1e-12)


@pytest.mark.slow
def test_arm_without_equilibrium_is_refused() -> None:
    truth = soft(builtin_robot("rb5"), 1e4)
    with pytest.raises(CalibError, match="no equilibrium"):
        solve_equilibrium(truth, random_poses(truth.robot, 4, rng=np.random.default_rng(0)))


def test_transmission_error_is_a_function_of_the_commanded_angle() -> None:
    robot = builtin_robot("rb5")
    cos_rad, sin_rad = np.zeros((6, 3)), np.zeros((6, 3))
    cos_rad[2] = [1e-4, 3e-4, 5e-5]
    sin_rad[4] = [2e-4, 0.0, 0.0]
    truth = Truth.without_effects(robot, np.eye(4)).with_effects(TransmissionError(cos_rad, sin_rad))
    q = random_poses(robot, 7, rng=np.random.default_rng(5))
    wanted = q.copy()
    wanted[:, 2] += 1e-4 * np.cos(q[:, 2]) + 3e-4 * np.cos(2 * q[:, 2]) + 5e-5 * np.cos(3 * q[:, 2])
    wanted[:, 4] += 2e-4 * np.sin(q[:, 4])
    np.testing.assert_allclose(solve_equilibrium(truth, q).q, wanted, atol=1e-15)
    assert truth.effect_names == ("transmission_error",)
