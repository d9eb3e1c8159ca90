"""The corner finder on scans of a simulator that it was not tuned on: found near the bound, or refused.

benchmarks/other_scanner.py counts over many more; the seeds here are representative and quick, not hard.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.corners.search import find_corner
from tests.support.mesh_cases import KINDS
from tests.support.mesh_parts import JigShape
from tests.support.mesh_scanners import Scanner, Seen
from tests.support.mesh_scene import Scene, bound, scan_of

FOUND = (
    ("light", 3),
    ("lines", 2),
    ("flight", 3),
    ("fused", 1),
    ("light, NaN", 1),
    ("screw holes", 0),
    ("chamfer 2 mm", 2),
    ("base plate flush", 0),
    ("cable", 1),
)
REFUSED = (
    ("covered face", 0),
    ("turned away, light", 0),
    ("turned away, light", 2),
    ("no jig, light", 1),
    ("light", 2),  # one face lies in the projector's shadow
)


@pytest.mark.thorough
def test_corners_lie_near_the_bound_and_the_covariance_says_so() -> None:
    ratios, squares = [], []
    for name, seed in FOUND:
        made, jig, sigma_mm = KINDS[name].scan(name, seed)
        assert made.fair, f"{name} {seed} shows no whole jig"
        corner = find_corner(made.scan, jig, scan_sigma_mm=sigma_mm).corner
        assert corner is not None, f"{name} {seed}"
        error = corner.xyz_mm - made.apex_mm
        ratios.append(float(np.linalg.norm(error)) / made.bound_mm)
        squares.append(float(error @ np.linalg.solve(corner.covariance_mm2, error)))
        assert squares[-1] < 25, f"{name} {seed}: squared Mahalanobis error {squares[-1]:.1f}"
    assert np.sqrt(np.mean(np.square(ratios))) < 2
    assert 0.7 < np.mean(squares) < 8  # ideal 3; blurred edges and heavy tails are in no model


@pytest.mark.slow
def test_a_sticker_moves_the_corner_no_farther_than_the_covariance_says() -> None:
    for seed in (0, 1):
        made, jig, sigma_mm = KINDS["sticker 0.3"].scan("sticker 0.3", seed)
        corner = find_corner(made.scan, jig, scan_sigma_mm=sigma_mm).corner
        error = corner.xyz_mm - made.apex_mm
        assert error @ np.linalg.solve(corner.covariance_mm2, error) < 25
        assert np.linalg.norm(error) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), REFUSED)
def test_no_corner_where_three_faces_of_a_jig_are_not_seen(name: str, seed: int) -> None:
    made, jig, sigma_mm = KINDS[name].scan(name, seed)
    assert not made.has_jig
    search = find_corner(made.scan, jig, scan_sigma_mm=sigma_mm)
    assert search.corner is None
    assert search.failure


@pytest.mark.slow
def test_points_without_noise_lie_on_planes_that_meet_square_in_the_apex() -> None:
    shape = JigShape(60.0, chamfer=1.0, tip_cut=2.0, holes=2, sticker=0.2, plate=0.5)
    scanner = Scanner("laser lines", points=30_000, sigma=1e-7, quantum=0.0, origin_away=40.0)
    made = scan_of(shape, scanner, Scene(bracket=True, cable=True), np.random.default_rng(4))
    normals = []
    for face in range(3):
        points = made.scan.points_mm[made.label == face] - made.apex_mm
        normal = np.linalg.svd(points, full_matrices=False)[2][2]  # of the plane through the apex
        assert len(points) > 100
        assert np.abs(points @ normal).max() < 3e-4  # coordinates are rounded to float32
        normals.append(normal)
    np.testing.assert_allclose(np.abs(np.array(normals) @ np.array(normals).T), np.eye(3), atol=1e-4)
    assert np.sum(made.label > 3) > 1000


def test_the_bound_is_what_weighted_fits_of_the_three_planes_scatter() -> None:
    rng = np.random.default_rng(9)
    turn, apex = Rotation.random(rng=rng).as_matrix(), np.array([10.0, -20, 500])
    label = np.repeat([0, 1, 2], [150, 80, 40])
    flat = rng.uniform(5, 50, (len(label), 2))
    inside = np.array([np.insert(uv, face, 0.0) for uv, face in zip(flat, label, strict=True)])
    sigma = rng.uniform(0.01, 0.05, len(label))
    true = apex + inside @ turn.T
    covariance = bound(Seen(true, label, true, label, sigma), turn, apex, heavy_tails=False)
    moves = np.empty((2000, 3))  # of the apex along the jig's axes: each plane's height there
    for face in range(3):
        on = label == face
        design = np.column_stack([np.ones(on.sum()), flat[on]]) / sigma[on, None]
        moves[:, face] = (np.linalg.pinv(design) @ rng.standard_normal((on.sum(), len(moves))))[0]
    np.testing.assert_allclose(np.cov((moves @ turn.T).T), covariance, atol=0.1 * np.trace(covariance))
