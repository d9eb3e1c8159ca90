"""Shapes as plain arrays in the unit of their arguments, without viser nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser.transforms

from calib.array_types import Array, ByteArray, IndexArray

DOT_MM = 5.0  # diameter of a corner in the scene
DOT_SHARE = 0.005  # of the field that the corners lie in, where that is more


def thin(points_mm: Array, limit: int) -> IndexArray:
    """Indices of at most `limit` points, one for each voxel, so that near and far parts stay equally dense."""
    count = len(points_mm)
    if count <= limit:
        return np.arange(count)
    low = points_mm.min(axis=0)
    extent = float((points_mm.max(axis=0) - low).max()) or 1.0
    edge = extent / np.sqrt(limit)  # scans are surfaces: about limit voxels of this size are on one
    while True:
        cells = np.minimum((points_mm - low) / edge, 2**20).astype(np.int64)
        _, kept = np.unique(cells @ (1, 2**21, 2**42), return_index=True)
        if len(kept) <= limit:
            return np.sort(kept)
        edge *= max(1.05, np.sqrt(len(kept) / limit))


def shaded(colour: ByteArray, normals: Array) -> ByteArray:
    """Colours (N, 3) of a colour (3,) on surfaces with these normals, lit from above the scanner."""
    light = np.array([-0.55, -0.70, -0.45])
    lit = np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)
    return np.asarray(np.clip(colour * (0.45 + 0.65 * lit)[:, None], 0, 255), dtype=np.uint8)


def ellipsoids(covariance_mm2: Array, factor: float) -> tuple[Array, Array]:
    """Orientations wxyz (N, 4) and half axes (N, 3), mm, of 1-sigma ellipsoids enlarged by `factor`."""
    variance, axes = np.linalg.eigh(np.asarray(covariance_mm2, dtype=float))
    axes[np.linalg.det(axes) < 0, :, 0] *= -1
    half = np.sqrt(np.maximum(variance, 0)) * factor
    wxyz = np.array([viser.transforms.SO3.from_matrix(a).wxyz for a in axes]).reshape(-1, 4)
    return wxyz, np.maximum(half, 1e-4)


def facing(normals: Array) -> Array:
    """Quaternions wxyz (N, 4) of the rotations that turn z to each of the unit normals (N, 3)."""
    other = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    x = np.cross(other, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    matrices = np.stack([x, np.cross(normals, x), normals], axis=2)
    return np.array([viser.transforms.SO3.from_matrix(m).wxyz for m in matrices]).reshape(-1, 4)


def jig_edges(xyz_mm: Array, normals: Array, centres_mm: Array, edges_mm: Sequence[float]) -> Array:
    """The three edges of the jig as lines (3, 2, 3) from its corner, mm.

    edges_mm  # three lengths; edge i leaves face i
    """
    lines = []
    for i, j, leaves in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        along = np.cross(normals[i], normals[j])
        along /= np.linalg.norm(along)
        if along @ (centres_mm[i] + centres_mm[j] - 2 * xyz_mm) < 0:
            along = -along
        lines.append([xyz_mm, xyz_mm + edges_mm[leaves] * along])
    return np.array(lines)


def disc() -> tuple[Array, IndexArray]:
    """Vertices (V, 3) and faces (F, 3) of a unit disc perpendicular to z."""
    sides = 32
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    vertices = np.c_[np.cos(angle), np.sin(angle), np.zeros(sides)]
    return vertices, np.array([[0, i, i + 1] for i in range(1, sides - 1)])


def unit_sphere(rings: int = 12, sectors: int = 20) -> tuple[Array, IndexArray]:
    """Vertices (V, 3) and faces (F, 3), outward, of a unit sphere."""
    from trimesh.creation import uv_sphere

    ball = uv_sphere(count=[rings, sectors])
    return np.asarray(ball.vertices), np.asarray(ball.faces)


def spread(points_mm: Array, centre_mm: Array) -> float:
    """Radius around the centre that holds nine of ten points."""
    return float(np.percentile(np.linalg.norm(points_mm - centre_mm, axis=1), 90)) if len(points_mm) else 0.0


def unit_cylinder() -> tuple[Array, IndexArray]:
    """Vertices (V, 3) and faces (F, 3), outward, of a cylinder of radius 1 and length 1 along z, about the origin."""
    from trimesh.creation import cylinder

    rod = cylinder(1.0, 1.0, sections=28).smooth_shaded  # its rims have their vertices twice: caps and side apart
    return np.asarray(rod.vertices), np.asarray(rod.faces)


def dot_mm(xyz_mm: Array) -> float:
    """Diameter, mm, at which the dots of points (N, 3) can be distinguished near and far."""
    return max(DOT_MM, DOT_SHARE * float(np.linalg.norm(np.ptp(xyz_mm, axis=0)))) if len(xyz_mm) else DOT_MM


def upright(count: int) -> Array:
    """Quaternions wxyz (N, 4) of no rotation."""
    return np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))


def loops(corners_mm: Array) -> Array:
    """Lines (K C, 2, 3) around polygons with corners (K, C, 3)."""
    return np.stack([corners_mm, np.roll(corners_mm, -1, axis=1)], axis=2).reshape(-1, 2, 3)
