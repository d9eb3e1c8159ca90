"""Neighbourhoods with fewer neighbours, compared with a new look-up of fewer."""

import numpy as np

from calib.planes.normals import estimate_normals, with_fewer_neighbours


def test_with_fewer_neighbours_is_what_a_look_up_of_fewer_gives() -> None:
    rng = np.random.default_rng(0)
    points = np.c_[rng.uniform(-50, 50, (3000, 2)), 700 + 0.05 * rng.standard_normal(3000)]
    points[:1000, 2] += 0.5 * points[:1000, 0]
    fewer, looked_up = with_fewer_neighbours(estimate_normals(points, 20), 9), estimate_normals(points, 9)
    np.testing.assert_array_equal(fewer.neighbours, looked_up.neighbours)
    np.testing.assert_allclose(fewer.radius_mm, looked_up.radius_mm)
    np.testing.assert_allclose(fewer.normals, looked_up.normals)
    np.testing.assert_allclose(fewer.thickness_mm, looked_up.thickness_mm)
