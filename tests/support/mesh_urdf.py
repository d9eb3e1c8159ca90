"""A ROS package with a URDF of three joints whose links have meshes, and where their corners are at given joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

ORIGINS = (  # xyz in m and rpy of each joint, its axis
    ((0.0, 0.0, 0.3), (0.0, 0.0, 0.4), (0, 0, 1)),
    ((0.1, 0.05, 0.0), (1.5, 0.1, 0.0), (0, 1, 0)),
    ((0.4, 0.0, 0.02), (0.0, 0.7, -0.3), (0, 0, -1)),
    ((0.2, 0.1, 0.0), (0.3, -0.8, 0.2), (1, 0, 0)),
    ((0.0, 0.02, 0.15), (-0.6, 0.2, 0.1), (0, 0, 1)),
    ((0.05, 0.0, 0.1), (0.9, 0.0, 0.5), (0, 1, 0)),
)
VISUAL = ((0.02, -0.01, 0.05), (0.2, 0.3, -0.5))  # of each link's mesh
SCALE = (0.001, 0.002, 0.001)


def transform(xyz, rpy):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
    return out


def write_package(folder: Path, name: str = "my_arm") -> Path:
    """Package `name` with meshes/part.stl, mm, and urdf/arm.urdf; returns the URDF."""
    package = folder / name
    for part in ("urdf", "meshes"):
        (package / part).mkdir(parents=True)
    (package / "package.xml").write_text(f"<package><name>{name}</name></package>")
    trimesh.creation.box(extents=(40, 30, 20)).export(package / "meshes" / "part.stl")
    mesh = f'<mesh filename="package://{name}/meshes/part.stl" scale="{" ".join(map(str, SCALE))}"/>'
    words = [" ".join(map(str, part)) for part in VISUAL]
    visual = f'<visual><origin xyz="{words[0]}" rpy="{words[1]}"/><geometry>{mesh}</geometry></visual>'
    parts = [f'<link name="l0">{visual}</link>']
    for k, (xyz, rpy, axis) in enumerate(ORIGINS):
        place = f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
        parts.append(
            f'<joint name="j{k + 1}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>{place}'
            f'<axis xyz="{" ".join(map(str, axis))}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
        parts.append(f'<link name="l{k + 1}">{visual}</link>')
    urdf = package / "urdf" / "arm.urdf"
    urdf.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
    return urdf


def link_frames(q):
    """base_T_link (n, 4, 4), in mm, of the links behind the joints."""
    at, out = np.eye(4), []
    for (xyz, rpy, axis), angle in zip(ORIGINS, q, strict=True):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec(np.array(axis, float) * angle).as_matrix()
        at = at @ transform(1e3 * np.array(xyz), rpy) @ turn
        out.append(at)
    return np.array(out)


def corners_mm(q) -> list:
    """Corners (8, 3) of each link's mesh in the base's frame, sorted."""
    box = trimesh.creation.box(extents=(40, 30, 20)).vertices * 1e3 * np.array(SCALE)
    placed = [frame @ transform(1e3 * np.array(VISUAL[0]), VISUAL[1]) for frame in link_frames(q)]
    return [in_order(box @ at[:3, :3].T + at[:3, 3]) for at in placed]


def in_order(points_mm):
    """Distinct points in an order of their own."""
    return np.unique(np.round(points_mm, 3), axis=0)
