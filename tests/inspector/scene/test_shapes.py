"""What is drawn has the right size and place, in the unit of what it was made from."""

from __future__ import annotations

import numpy as np
import pytest
import viser.transforms
from hypothesis import given
from hypothesis import strategies as st

from inspector.scene.scene_view import M_PER_MM, to_scene
from inspector.scene.shapes import (
    ellipsoids,
    jig_edges,
    thin,
)


@given(st.integers(0, 5000), st.integers(1, 800), st.integers(0, 2**32 - 1))
def test_thin_keeps_at_most_the_limit_of_real_points(count: int, limit: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3)) * (100, 50, 5)
    kept = thin(points, limit)
    assert len(kept) <= limit
    assert len(np.unique(kept)) == len(kept)
    assert len(kept) == min(count, limit) if count <= limit else len(kept) > 0


def test_thin_keeps_the_extent_and_evens_out_the_density() -> None:
    rng = np.random.default_rng(0)
    dense, sparse = rng.uniform(0, 10, (20_000, 2)), rng.uniform(0, 100, (20_000, 2))
    points = np.c_[np.vstack([dense, sparse]), np.zeros(40_000)]
    kept = points[thin(points, 4000)]
    assert np.ptp(kept, axis=0)[:2] == pytest.approx([100, 100], abs=3)
    in_corner = np.mean((kept[:, :2] < 10).all(axis=1))
    assert in_corner < 0.03  # 1 % of the area had half of the points


def test_thin_of_one_spot_and_of_nothing() -> None:
    assert len(thin(np.zeros((100, 3)), 10)) == 1
    assert len(thin(np.zeros((0, 3)), 10)) == 0


def test_ellipsoid_gives_back_the_covariance() -> None:
    rng = np.random.default_rng(1)
    a = rng.normal(size=(5, 3, 3)) * 0.01
    covariance = a @ a.transpose(0, 2, 1)
    wxyz, half = ellipsoids(covariance, 100.0)
    for i in range(5):
        axes = viser.transforms.SO3(wxyz[i]).as_matrix()
        np.testing.assert_allclose(axes @ np.diag((half[i] / 100) ** 2) @ axes.T, covariance[i], atol=1e-9)


def test_jig_edges_are_where_faces_meet_and_point_along_the_jig() -> None:
    apex, edges = np.array([1.0, 2, 700]), np.eye(3)
    normals = -np.eye(3)  # face i is spanned by the other two edges
    centres = np.array([apex + (edges.sum(axis=0) - edges[i]) * 20 for i in range(3)])
    lines = jig_edges(apex, normals, centres, (60.0, 70.0, 80.0))
    np.testing.assert_allclose(lines[:, 0], np.tile(apex, (3, 1)))
    ends = lines[[1, 2, 0], 1] - apex  # edge i leaves face i; the lines are those of faces 1-2, 2-3, 3-1
    np.testing.assert_allclose(ends, edges * [[60.0], [70.0], [80.0]], atol=1e-9)


def test_metres_are_made_in_one_place_and_keep_a_tenth_of_a_micrometre() -> None:
    points = np.random.default_rng(3).uniform(-1000, 1000, (1000, 3))
    assert M_PER_MM == 1e-3
    assert np.abs(to_scene(points).astype(float) * 1000 - points).max() < 1e-4
