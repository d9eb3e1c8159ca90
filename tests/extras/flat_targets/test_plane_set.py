"""Sets of planes in scans of the tests' own ray caster: the origin over its bound, ambiguous sets, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from calib.errors import TargetError
from calib.extras.flat_targets.plane_set import find_plane_set
from calib.target_shapes import PlaneSet
from calib.targets.protocol.finder import Wanted
from tests.support.flat_scene import placed, set_bound_mm2, square


def directions(*way: tuple[float, float, float]) -> np.ndarray:
    out = np.array(way)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


NORMALS = directions((0, 0, 1), (1, 0, 1), (-0.3, 0.9, 0.8), (-0.6, -0.8, 1.2))
OFFSETS = np.array([0.0, 30.0, 26.0, 22.0])
PIECES = [
    square(NORMALS[0], OFFSETS[0], np.array([0.0, 0, 0]), 24.0),
    square(NORMALS[1], OFFSETS[1], np.array([40.0, 0, 0]), 30.0),
    square(NORMALS[2], OFFSETS[2], np.array([-12.0, 42, 0]), 30.0),
    square(NORMALS[3], OFFSETS[3], np.array([-25.0, -38, 0]), 30.0),
]


def wanted(normals: np.ndarray = NORMALS, offsets: np.ndarray = OFFSETS) -> Wanted:
    rows = tuple((float(a), float(b), float(c)) for a, b, c in normals)
    return Wanted(PlaneSet(rows, tuple(offsets.tolist()), 30.0), scan_sigma_mm=0.02)


@pytest.mark.thorough
def test_the_origin_is_near_its_bound() -> None:
    ratios, squares = [], []
    for seed in range(8):
        scene = placed(np.random.default_rng(seed), PIECES, rays=20_000)
        found = find_plane_set(scene.scan, wanted())[0]
        error = found.xyz_mm - scene.origin_mm
        ratios.append(error @ error / np.trace(set_bound_mm2(scene, NORMALS, OFFSETS, PIECES)))
        squares.append(error @ np.linalg.solve(found.covariance_mm2, error))
        assert found.facts["planes"] >= 3
    assert np.sqrt(np.mean(ratios)) < 1.6
    assert np.mean(squares) < 6.5


def test_three_planes_at_angles_that_differ_are_enough() -> None:
    scene = placed(np.random.default_rng(20), PIECES[:3], rays=20_000)
    found = find_plane_set(scene.scan, wanted(NORMALS[:3], OFFSETS[:3]))[0]
    assert np.linalg.norm(found.xyz_mm - scene.origin_mm) < 0.05


def test_three_square_planes_at_different_offsets_can_be_named_in_three_ways() -> None:
    normals = directions((1, 0, 1), (-0.5, np.sqrt(0.75), 1 / 1), (-0.5, -np.sqrt(0.75), 1))
    offsets = np.array([20.0, 26.0, 32.0])
    middles = np.array([[30.0, 0, 0], [-18, 32, 0], [-20, -36, 0]])
    pieces = [square(n, d, m, 30.0) for n, d, m in zip(normals, offsets, middles, strict=True)]
    scene = placed(np.random.default_rng(3), pieces, rays=20_000)
    with pytest.raises(TargetError, match="more than one way"):
        find_plane_set(scene.scan, wanted(normals, offsets))


def test_a_set_that_is_not_in_view_is_refused() -> None:
    scene = placed(np.random.default_rng(4), [], rays=10_000)
    with pytest.raises(TargetError, match="no three of them meet at the angles"):
        find_plane_set(scene.scan, wanted())
