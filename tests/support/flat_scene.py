"""Scans of flat parts by casting rays: sets of planes and plates, with the truth; no code of `calib.targets`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.scans.scan import Scan
from tests.support.scan_scene import Patch
from tests.support.sphere_scene import Piece, scan_of, surroundings

SIGMA_MM = 0.02


@dataclass(frozen=True)
class FlatScan:
    """A scan of flat parts with its truth."""

    scan: Scan
    origin_mm: NDArray  # (3,)
    scanner_R_part: NDArray  # (3, 3)


def square(normal: NDArray, offset: float, about: NDArray, size: float) -> Patch:
    """A square piece of the plane normal . p = offset, its middle nearest to `about`."""
    axes = np.linalg.svd(normal[None])[2][1:]
    middle = about + (offset - normal @ about) * normal
    return Patch(middle - size / 2 * (axes[0] + axes[1]), size * axes[0], size * axes[1])


def placed(rng: np.random.Generator, pieces: list[Patch], *, rays: int, others: int = 99) -> FlatScan:
    """A part in its own frame, z toward the scanner, tilted, 700 mm away; the first `others` are wall and table."""
    tilt = Rotation.from_rotvec(np.append(rng.uniform(-0.25, 0.25, 2), 0.0))
    turn = (tilt * Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)) * Rotation.from_euler("x", np.pi)).as_matrix()
    origin = np.array([*rng.uniform(-15, 15, 2), 700.0])
    there: list[Piece] = [Patch(turn @ p.origin + origin, turn @ p.u, turn @ p.v, p.shape) for p in pieces]
    beside = surroundings(rng, 700.0)[:others]
    seen = scan_of(rng, [], [*there, *beside], rays=rays, sigma_mm=SIGMA_MM)
    return FlatScan(seen.scan, origin, turn)


def set_bound_mm2(scene: FlatScan, normals: NDArray, offsets: NDArray, pieces: list[Patch]) -> NDArray:
    """Cramer-Rao bound (3, 3) of the origin: points that lie on the pieces, noise along their rays, six unknowns."""
    points = scene.scan.points_mm
    information = np.zeros((6, 6))
    for n, d, piece in zip(normals, offsets, pieces, strict=True):
        there = scene.scanner_R_part @ n
        corner, u, v = (scene.scanner_R_part @ a for a in (piece.origin, piece.u, piece.v))
        way = points - scene.origin_mm
        over = way @ there - d
        a, b = (way - corner) @ u / (u @ u), (way - corner) @ v / (v @ v)
        on = (np.abs(over) < 0.5) & (a > 0) & (a < 1) & (b > 0) & (b < 1)
        cosine = np.abs(points[on] @ there) / np.linalg.norm(points[on], axis=1)
        sigma = SIGMA_MM * (0.5 + 0.5 / cosine**2) * cosine
        rows = np.column_stack([np.cross(there, way[on]), np.tile(-there, (on.sum(), 1))]) / sigma[:, None]
        information += rows.T @ rows
    return np.linalg.inv(information)[3:, 3:]
