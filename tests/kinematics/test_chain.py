"""The chain against elementary transforms, against another engine, and its Jacobian against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot
from tests.support.arms import elementary_points, jang_arm, park_arm, perturbed, random_arm

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.integers(1, 7))
def test_eq_3_is_the_product_of_elementary_transforms(seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    arm = perturbed(random_arm(rng, joints, prismatic=int(rng.integers(joints))), rng, rad=0.3)
    q = rng.uniform(-np.pi, np.pi, (4, joints))
    np.testing.assert_allclose(kinematics.target_points(arm, q), elementary_points(arm, q), atol=1e-9)


@pytest.mark.thorough
@given(SEEDS, st.integers(1, 6))
def test_the_jacobian_is_the_derivative(seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    arm = perturbed(random_arm(rng, joints, prismatic=joints - 1), rng, rad=0.2)
    q = rng.uniform(-np.pi, np.pi, (3, joints))
    jacobian = kinematics.target_jacobian(arm, q)
    for k in range(jacobian.shape[2]):
        step = np.zeros(arm.table.size)
        step[k] = 1e-5
        step = step.reshape(arm.table.shape)
        high = elementary_points(arm.with_table(arm.table + step), q)
        low = elementary_points(arm.with_table(arm.table - step), q)
        np.testing.assert_allclose(jacobian[:, :, k], (high - low) / 2e-5, atol=2e-5)


def test_a_table_for_each_pose_equals_each_pose_by_itself() -> None:
    rng = np.random.default_rng(3)
    arm = jang_arm()
    q = rng.uniform(-3, 3, (5, 6))
    tables = np.stack([perturbed(arm, rng).table for _ in range(5)])
    together = kinematics.forward(tables, q, arm.is_revolute).target_mm
    for i in range(5):
        alone = kinematics.target_points(arm.with_table(tables[i]), q[i : i + 1])
        np.testing.assert_array_equal(together[i], alone[0])


def mjcf(robot: Robot) -> str:
    """The arm as nested MuJoCo bodies: a hinge or slide about z at each joint, then the link's fixed transform."""
    opening, closing = [], []
    for i, joint in enumerate(robot.joints):
        kind = "hinge" if joint.is_revolute else "slide"
        opening.append(
            f'<body name="j{i}" euler="0 0 {joint.theta_rad!r}"><joint type="{kind}" axis="0 0 1"/>'
            f'<geom size="1" mass="1"/><body name="l{i}" pos="{joint.a_mm!r} 0 {joint.d_mm!r}" '
            f'euler="{joint.alpha_rad!r} {joint.beta_rad!r} 0"><geom size="1" mass="1"/>'
        )
        closing.append("</body></body>")
    tool = robot.tool
    tip = f'<body name="t" euler="0 0 {tool.theta_rad!r}"><body name="tip" pos="{tool.a_mm!r} 0 {tool.d_mm!r}"/></body>'
    return (
        '<mujoco><compiler angle="radian" eulerseq="xyz"/><worldbody>'
        + "".join(opening) + tip + "".join(reversed(closing)) + "</worldbody></mujoco>"
    )  # fmt: skip


@pytest.mark.parametrize("name", ["rb5", "panda", "scara"])
def test_another_engine_puts_the_tool_at_the_same_place(name: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    rng = np.random.default_rng(5)
    arm = perturbed(random_arm(rng, 4, prismatic=2) if name == "scara" else park_arm(name), rng, rad=0.1)
    model = mujoco.MjModel.from_xml_string(mjcf(arm))
    data = mujoco.MjData(model)
    for q in rng.uniform(-np.pi, np.pi, (10, arm.n_joints)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.body("tip").xpos, kinematics.target_points(arm, q[None])[0], atol=1e-9)
