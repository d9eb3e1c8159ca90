"""Points near a place, compared with distances computed one by one."""

import numpy as np

from calib.planes.point_selection import points_within


def test_points_within_a_radius_are_those_whose_distance_is_less() -> None:
    rng = np.random.default_rng(0)
    points = np.array([700.0, -300.0, 900.0]) + rng.normal(scale=60, size=(70_000, 3))
    points[[5, 40_000, 69_999]] = [np.nan, 0, 0], [0, np.inf, 0], [1e300, 0, 0]
    centre = np.array([710.0, -290.0, 880.0])
    near, way = points_within(points, centre, 55.0)
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.linalg.norm(points - centre, axis=1)
    np.testing.assert_array_equal(near, np.flatnonzero(distance < 55.0))
    np.testing.assert_array_equal(way, points[near] - centre)
    assert len(near) > 5000


def test_of_no_points_none_is_near() -> None:
    near, way = points_within(np.zeros((0, 3)), np.zeros(3), 1.0)
    assert near.shape == (0,)
    assert way.shape == (0, 3)
