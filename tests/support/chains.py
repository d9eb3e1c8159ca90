"""Random serial chains, and URDFs of them written by other code than the product's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.robot_formats.chain.serial_chain import ChainJoint, SerialChain

GIMBAL = np.pi / 2


def transform(xyz_mm: Any, rpy_rad: Any) -> NDArray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", rpy_rad).as_matrix()
    out[:3, 3] = xyz_mm
    return out


def random_origin(rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Lengths up to 400 mm and angles of every kind: any, square, none, nearly none, gimbal lock, half a turn."""
    kinds = rng.integers(0, 6, 3)
    square = rng.choice([-2, -1, 0, 1, 2], 3) * np.pi / 2
    some = [
        rng.uniform(-np.pi, np.pi, 3),
        square,
        np.zeros(3),
        rng.normal(0, 1e-7, 3),
        square + 1e-9,
        square * 2,
    ]
    rpy = np.array([some[kind][k] for k, kind in enumerate(kinds)])
    if rng.random() < 0.2:
        rpy[1] = rng.choice([-1, 1]) * GIMBAL
    xyz = rng.uniform(-400, 400, 3) * rng.choice([0.0, 1.0, 1.0], 3)
    return xyz, rpy


def random_axis(rng: np.random.Generator) -> NDArray:
    if rng.random() < 0.6:
        return rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3)]
    axis = rng.normal(size=3)
    return axis / np.linalg.norm(axis)


def random_chain(rng: np.random.Generator) -> SerialChain:
    """2 to 8 joints of any kind, with masses."""
    joints = []
    for k in range(int(rng.integers(2, 9))):
        x, y, z = map(float, random_axis(rng))
        cx, cy, cz = map(float, rng.uniform(-100, 100, 3))
        joints.append(
            ChainJoint(
                name=f"joint_{k + 1}",
                before_T_joint=transform(*random_origin(rng)),
                axis=(x, y, z),
                type="prismatic" if rng.random() < 0.2 else "revolute",
                min=-2.0,
                max=2.5,
                mass_kg=float(rng.uniform(0.1, 20.0)),
                com_mm=(cx, cy, cz),
            )
        )
    return SerialChain("drawn", tuple(joints), transform(*random_origin(rng)))


def chains(count: int, seed: int = 0) -> Iterator[tuple[SerialChain, NDArray]]:
    """Chains, each with three joint vectors."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        chain = random_chain(rng)
        turns = np.array([joint.is_revolute for joint in chain.joints])
        yield chain, rng.uniform(-3, 3, (3, len(turns))) * np.where(turns, 1.0, 100.0)


def urdf_of(links: str = "", joints: str = "", name: str = "arm") -> str:
    """A URDF around elements."""
    return f'<?xml version="1.0"?>\n<robot name="{name}">\n{links}{joints}</robot>\n'


def link(name: str, mass_kg: float | None = None, com: str = "0 0 0") -> str:
    if mass_kg is None:
        return f'  <link name="{name}"/>\n'
    inertia = '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>'
    return (
        f'  <link name="{name}"><inertial><origin xyz="{com}" rpy="0 0 0"/><mass value="{mass_kg}"/>{inertia}'
        "</inertial></link>\n"
    )


def joint(
    name: str,
    parent: str,
    child: str,
    xyz: str = "0 0 0",
    rpy: str = "0 0 0",
    axis: str | None = "0 0 1",
    type: str = "revolute",
    more: str = "",
) -> str:
    limit = '<limit lower="-2.5" upper="2.5" effort="1" velocity="1"/>' if type in ("revolute", "prismatic") else ""
    turns_about = "" if axis is None or type == "fixed" else f'<axis xyz="{axis}"/>'
    return (
        f'  <joint name="{name}" type="{type}">\n    <origin xyz="{xyz}" rpy="{rpy}"/>\n    <parent link="{parent}"/>\n'
        f'    <child link="{child}"/>\n    {turns_about}{limit}{more}\n  </joint>\n'
    )


def shoulder_arm() -> str:
    """An arm with all that a real URDF has: a negative axis, y axes, a slide, fixed joints between, branches."""
    links = "".join(
        [
            link("world"),
            link("base_link", 4.0),
            link("marker"),
            link("shoulder", 3.7, "0 -0.02 0.1"),
            link("upper", 8.1, "0.01 0 0.28"),
            link("box", 1.5, "0.02 0.03 0.04"),
            link("forearm", 2.3, "0 0.01 0.2"),
            link("slider", 1.2, "0 0 0.05"),
            link("wrist", 0.9, "0.01 0.02 0.03"),
            link("flange"),
            link("tool0"),
            link("finger", 0.2, "0.03 0 0.01"),
        ]
    )
    joints = "".join(
        [
            joint("world_fixed", "world", "base_link", "0.1 0.2 0.3", "0.2 -0.3 1.1", type="fixed"),
            joint("marker_fixed", "base_link", "marker", "1 1 1", type="fixed"),
            joint("pan", "base_link", "shoulder", "0 0 0.1273"),
            joint("lift", "shoulder", "upper", "0 0.22094 0", "0 1.570796327 0", "0 1 0", "continuous"),
            joint("box_fixed", "upper", "box", "0.1 0 0.05", "0.3 0.2 0.1", type="fixed"),
            joint("elbow", "box", "forearm", "0 -0.1719 0.512", "-0.3 0.1 0", "0 -1 0"),
            joint("slide", "forearm", "slider", "0 0.01 0.4", "0 0 0.4", "0.6 0 0.8", "prismatic"),
            joint("roll", "slider", "wrist", "0.02 0 0.1", "0 1.5707963267948966 0", None, "continuous"),
            joint("flange_fixed", "wrist", "flange", "0.0922 0 0", "0 0 1.57", type="fixed"),
            joint("tool_fixed", "flange", "tool0", "0.01 0.02 0.1", "0 1.5707963267948966 0.3", type="fixed"),
            joint("finger_slide", "flange", "finger", "0.05 0 0", axis="0 1 0", type="prismatic"),
        ]
    )
    return urdf_of(links, joints, "shoulder_arm")
