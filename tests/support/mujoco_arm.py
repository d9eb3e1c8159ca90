"""A robot as a MuJoCo model: an engine that shares no code with the truth's mechanism or with the method."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.kinematics.robot import Robot
from calib.simulation.truth.mechanism import Arm


def mujoco() -> Any:
    """Module `mujoco`; a test that asks for it is skipped where it is not installed."""
    return pytest.importorskip("mujoco")


def frames(robot: Robot, q: Any) -> tuple[NDArray, ...]:
    return Arm.commanded_to(robot, q).base_T_frame


def mujoco_model(robot: Robot, payload_kg: float = 0.0) -> Any:
    """The arm as a MuJoCo model in metres: one body a link, its joint at the frame before it."""
    chain = [T[0] for T in frames(robot, np.zeros((1, robot.n_joints)))]
    rest = [np.linalg.inv(before) @ after for before, after in itertools.pairwise(chain)]

    def numbers(values: Any) -> str:
        return " ".join(f"{v:.17g}" for v in np.asarray(values, dtype=float))

    def pose(T: NDArray) -> str:
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        return f'pos="{numbers(T[:3, 3] / 1e3)}" quat="{numbers([w, x, y, z])}"'

    def mass(kg: float, place_mm: Any) -> str:
        return f'<inertial pos="{numbers(np.array(place_mm) / 1e3)}" mass="{kg:.17g}" diaginertia="1e-4 1e-4 1e-4"/>'

    tool = f'<site name="target" {pose(rest[-1])}/>'
    for kg, place_mm in ((robot.tool.mass_kg, robot.tool.com_mm), (payload_kg, robot.tool.payload_com_mm)):
        tool += f"<body>{mass(kg, place_mm)}</body>" if kg else ""
    inner = tool
    for joint, T in reversed(list(zip(robot.joints, rest, strict=False))):
        axis, origin_mm = T[:3, :3].T @ [0.0, 0.0, 1.0], -T[:3, :3].T @ T[:3, 3]
        kind = "hinge" if joint.is_revolute else "slide"
        joint_xml = f'<joint type="{kind}" axis="{numbers(axis)}" pos="{numbers(origin_mm / 1e3)}"/>'
        inner = f"<body {pose(T)}>{joint_xml}{mass(joint.mass_kg or 0.0, joint.com_mm)}{inner}</body>"
    inner = f"<body {pose(chain[0])}>{inner}</body>"
    gravity = numbers(robot.gravity_m_s2)
    return mujoco().MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{gravity}"/><worldbody>{inner}</worldbody></mujoco>'
    )


def in_mujoco(model: Any, robot: Robot, q: NDArray) -> Any:
    data = mujoco().MjData(model)
    data.qpos[:] = np.where(robot.is_revolute, q, q / 1e3)
    mujoco().mj_forward(model, data)
    return data
