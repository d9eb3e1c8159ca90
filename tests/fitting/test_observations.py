"""Means over a pose's points equal those of plain loops, for any order and shape of the points."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from calib.statistics import group_means, group_sums


@given(row=st.lists(st.integers(0, 5), min_size=1, max_size=30), seed=st.integers(0, 99))
def test_each_pose_has_the_mean_of_its_own_points(row: list[int], seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=(len(row), 2, 3))
    rows = np.array(row)
    mean, count = group_means(values, rows, 6, empty=np.nan), np.bincount(rows, minlength=6)
    for pose in range(6):
        own = values[rows == pose]
        assert count[pose] == len(own)
        expected = own.mean(axis=0) if len(own) else np.full((2, 3), np.nan)
        np.testing.assert_allclose(mean[pose], expected, atol=1e-14)
        np.testing.assert_allclose(group_sums(values, rows, 6)[pose], own.sum(axis=0), atol=1e-13)


def test_a_pose_without_points_is_zero_unless_said_otherwise() -> None:
    np.testing.assert_array_equal(group_means(np.array([2.0, 4.0]), np.array([1, 1]), 3), [0.0, 3.0, 0.0])
