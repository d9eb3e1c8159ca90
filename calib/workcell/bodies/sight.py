"""Lines of sight from a scanner to points on the jig, and their occlusion by the arm's bodies and meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.array_types import Array, BoolArray
from calib.frames import invert
from calib.kinematics.chain import Chain
from calib.workcell.bodies.arm_bodies import ArmBodies
from calib.workcell.bodies.distances import between_segments
from calib.workcell.bodies.link_mesh import LinkMesh


def hidden_by_arm(bodies: ArmBodies, chain: Chain, eye_mm: Array, points_mm: Array) -> BoolArray:
    """Mask (N, P): a body of the arm is between the scanner at eye_mm (N, 3) and points (N, P, 3), base frame."""
    start, end = bodies.at(chain)
    hidden = np.zeros(points_mm.shape[:2], dtype=bool)
    for k in np.flatnonzero(bodies.hides):
        apart = between_segments(eye_mm[:, None], points_mm, start[:, k, None], end[:, k, None])
        near = apart < bodies.radius_mm[k]
        mesh = bodies.meshes.get(int(bodies.link[k]))
        if mesh is not None and near.any():
            near = _hidden_by_mesh(mesh, chain.base_T_frame[:, bodies.link[k] + 1], eye_mm, points_mm, near)
        hidden |= near
    return hidden


def _hidden_by_mesh(mesh: LinkMesh, base_T_link: Array, eye_mm: Array, points_mm: Array, asked: BoolArray) -> BoolArray:
    """Mask (N, P): whether triangles of a link's mesh hide the points, checked where `asked`; elsewhere False."""
    import open3d as o3d

    tensor: Any = o3d.core.Tensor
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(mesh.vertices_mm.astype(np.float32)), tensor(mesh.triangles.astype(np.uint32)))
    pose, point = np.nonzero(asked)
    link_T_base = np.array([invert(frame) for frame in base_T_link])[pose]
    turn = link_T_base[:, :3, :3]
    eye = np.einsum("rij,rj->ri", turn, eye_mm[pose]) + link_T_base[:, :3, 3]
    along = np.einsum("rij,rj->ri", turn, points_mm[pose, point] - eye_mm[pose])
    rays = np.concatenate([eye, along], axis=1).astype(np.float32)  # a hit at 1 is the point itself
    hit = scene.cast_rays(tensor(rays))["t_hit"].numpy()
    hidden = np.zeros_like(asked)
    hidden[pose, point] = hit < 1.0
    return hidden


def on_faces(base_T_jig: Array, edges_mm: Array) -> Array:
    """Points (N, P, 3) on the faces of jigs at base_T_jig (N, 4, 4) with edge ends (3, 3), base frame."""
    one, other = edges_mm[[1, 2, 0]], edges_mm[[2, 0, 1]]
    in_jig = np.concatenate([s * one + t * other for s, t in _SHARES])
    return np.einsum("nij,pj->npi", base_T_jig[:, :3, :3], in_jig) + base_T_jig[:, None, :3, 3]


_SHARES = ((0.1, 0.1), (0.33, 0.33), (0.85, 0.07), (0.07, 0.85))
"""Shares of a face's two edges: near the apex, in the middle, and near the ends of the edges."""
