"""Rigid transforms: group laws, and the best fit for exact and inexact motions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import frames
from tests.support.arms import random_transform

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS)
def test_a_transform_and_its_inverse_cancel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a_T_b = np.stack([random_transform(rng) for _ in range(3)])
    cancelled = a_T_b @ frames.invert(a_T_b) - np.eye(4)
    np.testing.assert_allclose(cancelled[:, :3, :3], 0.0, atol=1e-14)
    np.testing.assert_allclose(cancelled[:, :3, 3], 0.0, atol=1e-11)  # mm: shifts of metres, rounded
    np.testing.assert_array_equal(cancelled[:, 3], 0.0)


@given(SEEDS)
def test_applying_chains_as_multiplying_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a_T_b, b_T_c, points = random_transform(rng), random_transform(rng), rng.normal(size=(7, 3)) * 100
    np.testing.assert_allclose(
        frames.apply(a_T_b @ b_T_c, points), frames.apply(a_T_b, frames.apply(b_T_c, points)), atol=1e-10
    )


@given(SEEDS)
def test_the_best_fit_finds_the_motion_that_was_made(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, points = random_transform(rng), rng.normal(size=(10, 3)) * 300
    found = frames.best_fit_transform(points, points @ truth[:3, :3].T + truth[:3, 3])
    np.testing.assert_allclose(found, truth, atol=1e-9)


@given(SEEDS)
def test_no_small_motion_improves_the_best_fit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = rng.normal(size=(12, 3)) * 100, rng.normal(size=(12, 3)) * 100
    weights = rng.uniform(0.1, 3.0, 12)

    def cost(transform: np.ndarray) -> float:
        return float(weights @ np.sum((frames.apply(transform, source) - target) ** 2, axis=1))

    best = frames.best_fit_transform(source, target, weights)
    assert np.linalg.det(best[:3, :3]) == pytest.approx(1.0)
    for axis in np.eye(6) * 1e-4:
        nudge = frames.make_transform(frames.rotation_from_rotvec(axis[3:]), axis[:3])
        assert cost(nudge @ best) >= cost(best) * (1 - 1e-12)


def test_points_on_a_line_still_give_a_rotation() -> None:
    line = np.outer(np.linspace(0, 100, 5), [1.0, 2.0, 0.5])
    moved = line + np.array([10.0, 0.0, 0.0])
    found = frames.best_fit_transform(line, moved)
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(frames.apply(found, line), moved, atol=1e-9)


def test_skew_is_the_cross_product() -> None:
    rng = np.random.default_rng(0)
    v, w = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", frames.skew(v), w), np.cross(v, w))
