"""Filters 1-3 on sets with known answers, and the drawing of sets."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from calib.planes.filters import (
    FilterTolerances,
    apply_filters,
    draw_sample_sets,
    filter_1,
    filter_2,
    filter_3,
    triangle_normals,
)

UP = np.array([0.0, 0.0, 1.0])
SQUARE = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0], [4, 4, 0]])  # each point 2.83 from the centroid
TOLERANCES = FilterTolerances((1.5, 20.0), np.radians(8), np.radians(5))


def tilted(degrees: float) -> np.ndarray:
    return np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])


@pytest.mark.parametrize(("scale", "passes"), [(0.5, False), (1.0, True), (7.0, True), (7.2, False)])
def test_filter_1_wants_every_distance_inside_the_range(scale: float, passes: bool) -> None:
    assert filter_1(scale * SQUARE[None], (1.5, 20.0))[0] == passes


def test_filter_1_one_point_at_the_centroid_is_enough_to_fail() -> None:
    star = np.array([[0.0, 0, 0], [4, 0, 0], [-2, 3.46, 0], [-2, -3.46, 0]])
    assert not filter_1(star[None], (0.5, 20.0))[0]


@pytest.mark.parametrize(("degrees", "passes"), [(7.9, True), (8.1, False), (180.0, False)])
def test_filter_2_holds_the_normals_against_each_other(degrees: float, passes: bool) -> None:
    normals = np.stack([UP, UP, UP, tilted(degrees)])
    assert filter_2(normals[None], np.radians(8))[0] == passes


def test_filter_2_sees_pairs_that_the_first_point_is_between() -> None:
    normals = np.stack([UP, tilted(6), tilted(-6), UP])  # each 6 deg from the first, 12 from each other
    assert not filter_2(normals[None], np.radians(8))[0]


def test_filter_3_catches_points_on_two_parallel_faces() -> None:
    steps = SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 3.0]])
    normals = np.tile(UP, (1, 4, 1))
    assert filter_2(normals, np.radians(1))[0]  # their own normals agree
    assert not filter_3(triangle_normals(steps[None]), normals, np.radians(5))[0]
    assert filter_3(triangle_normals(SQUARE[None]), normals, np.radians(5))[0]


def test_a_point_drawn_twice_fails_filter_3() -> None:
    twice = SQUARE[[0, 1, 2, 2]][None]
    assert not filter_3(triangle_normals(twice), np.tile(UP, (1, 4, 1)), np.radians(5))[0]


def test_each_set_records_the_first_filter_that_rejected_it() -> None:
    step = SQUARE + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 3.0]])
    points = np.stack([SQUARE, 0.1 * SQUARE, SQUARE, step])
    normals = np.tile(UP, (4, 4, 1))
    normals[1, 0] = normals[2, 0] = tilted(30)
    sets = apply_filters(points, normals, TOLERANCES)
    assert sets.rejected_by.tolist() == [0, 1, 2, 3]
    assert sets.passed().tolist() == [0]
    np.testing.assert_allclose(sets.centroids_mm[0], [2, 2, 0])


def test_a_set_takes_the_side_of_its_points_normals() -> None:
    points = np.stack([SQUARE, SQUARE])
    normals = np.stack([np.tile(UP, (4, 1)), np.tile(-UP, (4, 1))])
    np.testing.assert_allclose(apply_filters(points, normals, TOLERANCES).normals, [UP, -UP], atol=1e-12)


def test_local_sets_are_neighbours_and_random_ones_are_not() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1000, (4000, 2))
    neighbours = cKDTree(points).query(points, k=20)[1]
    local = draw_sample_sets(neighbours, 1000, rng)
    anywhere = draw_sample_sets(neighbours, 1000, rng, local=False)
    assert local.shape == anywhere.shape == (1000, 4)

    def reach(sets: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points[sets] - points[sets].mean(axis=1, keepdims=True), axis=2).max(axis=1)

    assert reach(local).max() < 320  # 20 of 4000 points lie within about 40: at most 8 such steps
    assert np.median(reach(local)[:500]) < np.median(reach(local)[500:]) / 1.5  # two scales
    assert np.median(reach(anywhere)) > 300


def test_the_same_generator_draws_the_same_sets() -> None:
    points = np.random.default_rng(0).uniform(size=(300, 3))
    neighbours = cKDTree(points).query(points, k=20)[1]
    first = draw_sample_sets(neighbours, 100, np.random.default_rng(7))
    np.testing.assert_array_equal(first, draw_sample_sets(neighbours, 100, np.random.default_rng(7)))


def test_sets_are_drawn_around_the_points_that_are_asked_for() -> None:
    """On a line of points with their nearest neighbours, a walk of 8 steps ends at most 8 places away."""
    neighbours = np.clip(np.arange(1000)[:, None] + [0, -1, 1], 0, 999)
    drawn = draw_sample_sets(neighbours, 400, np.random.default_rng(2), around=np.array([500, 900]))
    assert np.all(np.minimum(np.abs(drawn - 500), np.abs(drawn - 900)) <= 8)
    assert 0.3 < np.mean(drawn < 700) < 0.7
