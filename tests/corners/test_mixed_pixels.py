"""Pixels that see across the jig's edges: the shares that are estimated, and scans where none are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.faces import mixed_pixels
from calib.corners.faces.mixed_pixels import MixedPixels, find_mixed_pixels, moved_back
from calib.corners.search import find_corner
from calib.jig import Jig, Outline
from calib.planes.robust_fit import PlaneFit
from calib.statistics import rms
from tests.support.mesh_parts import JigShape
from tests.support.mesh_scanners import Scanner
from tests.support.mesh_scene import MeshScan, Scene, scan_of
from tests.support.scan_scene import grazing

ORIGIN = np.array([3.0, -8.0, 700.0])
JIG = Jig()
OUTLINE = Outline(JIG.edges_mm)


def _steep_scan(seed: int, **shape: float) -> MeshScan:
    """Structured-light scan, smoothed over 3 x 3 pixels (shares 0.59, 0.09 and 0.013), 1 mm from pixel to pixel."""
    scanner = Scanner(points=12_000, field=150.0, heavy_tails=False, quantum=0.0, patches=0)
    return scan_of(JigShape(**shape), scanner, Scene(workshop=False, steepest_deg=78.0), np.random.default_rng(seed))


def _camera(kernel: NDArray, pitch_rad: float, rng: np.random.Generator, sigma_mm: float = 0.02) -> tuple:
    """Points of a cube's corner, one face at a flat angle, each pixel's inverse depth a mean by the kernel (3, 3).

    Returns them about the apex, the true normals, and which face each point is on.
    """
    turn = grazing(np.random.default_rng(1), 76.0)
    normals = -turn.T
    offsets = normals @ ORIGIN
    steps = np.arange(-60, 61) * pitch_rad
    x, y = np.meshgrid(ORIGIN[0] / ORIGIN[2] + steps, ORIGIN[1] / ORIGIN[2] + steps)
    inverse = np.stack([(n[0] * x + n[1] * y + n[2]) / d for n, d in zip(normals, offsets, strict=True)])
    mixed = sum(kernel[i, j] * np.roll(inverse.min(axis=0), (i - 1, j - 1), (0, 1)) for i in range(3) for j in range(3))
    face = inverse.argmin(axis=0)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    points = (rays / mixed[..., None])[1:-1, 1:-1]
    face = face[1:-1, 1:-1]
    heights = points @ normals.T - offsets
    inside = np.all(-heights < 60, axis=-1) & (np.sum(-heights, axis=-1) < 60) & (face >= 0)
    points = points[inside]
    points = points * (1 + sigma_mm * rng.standard_normal(len(points)) / ORIGIN[2])[:, None]
    return points - ORIGIN, normals, face[inside]


def _true_planes(local: NDArray, normals: NDArray, face: NDArray, sigma_mm: float) -> list[PlaneFit]:
    planes = []
    for i, normal in enumerate(normals):
        on = np.flatnonzero(face == i)
        axes = np.linalg.svd(normal[None])[2][1:]
        planes.append(
            PlaneFit(normal, 0.0, local[on].mean(axis=0), axes, on, local[on], np.zeros(len(on)), 1.0, sigma_mm)
        )
    return planes


def test_the_kernel_of_the_pixels_is_learned_and_taken_off() -> None:
    share = np.array([0.115, 0.77, 0.115])
    rng = np.random.default_rng(4)
    local, normals, face = _camera(np.outer(share, share), 1.1 / 700, rng, sigma_mm=0.01)
    planes = _true_planes(local, normals, face, 0.01)
    mixed = find_mixed_pixels(local, planes, ORIGIN, JIG, OUTLINE)
    assert mixed.faces.any()
    assert mixed.grid.pitch_rad == pytest.approx(1.1 / 700, rel=0.01)
    assert mixed.shares == pytest.approx([0.77 * 0.115, 0.115**2, 0.0], abs=0.01)
    narrow = int(np.flatnonzero(mixed.faces)[-1])
    on = face == narrow
    before = (local @ normals[narrow])[on]
    after = (moved_back(local, planes, narrow, ORIGIN, JIG, mixed) @ normals[narrow])[on]
    assert rms(after) < 0.6 * rms(before)


def test_pixels_that_see_a_single_place_each_are_left_alone() -> None:
    alone = np.zeros((3, 3))
    alone[1, 1] = 1
    local, normals, face = _camera(alone, 1.1 / 700, np.random.default_rng(4))
    planes = _true_planes(local, normals, face, 0.02)
    assert find_mixed_pixels(local, planes, ORIGIN, JIG, OUTLINE) is None


@pytest.mark.slow
def test_steep_coarsely_scanned_faces_come_near_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scans of the mesh simulator: 40 to 60 points on a face at 78 degrees, of which mixing spoils a third."""

    def ratios() -> NDArray:
        found = []
        for seed in (0, 1, 2, 4, 5, 6, 7):  # 3 has 31 points on that face, and is refused
            made = _steep_scan(seed)
            corner = find_corner(made.scan, JIG, scan_sigma_mm=0.02).corner
            found.append(np.linalg.norm(corner.xyz_mm - made.apex_mm) / made.bound_mm)
        return np.array(found)

    with_mixing = ratios()
    monkeypatch.setattr(mixed_pixels, "find_mixed_pixels", lambda *_: None)
    without = ratios()
    assert rms(with_mixing) < 2.3
    assert rms(with_mixing) < 0.7 * rms(without)


@pytest.mark.slow
def test_a_bevel_is_not_taken_for_pixels(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[MixedPixels | None] = []

    def noted(*arguments: object) -> MixedPixels | None:
        asked.append(find_mixed_pixels(*arguments))  # type: ignore[arg-type]
        return asked[-1]

    monkeypatch.setattr(mixed_pixels, "find_mixed_pixels", noted)
    for seed in range(4):
        find_corner(_steep_scan(seed, chamfer=2.0).scan, JIG, scan_sigma_mm=0.02)
    assert asked
    assert asked == [None] * len(asked)
