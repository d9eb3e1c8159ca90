"""Rivals told apart by further poses: gaps against plain formulas, probabilities against draws, choices against all."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib.array_types import Array
from calib.screening.rivals.pose_choice import choose_poses, mistaken_beside
from calib.screening.rivals.predictions import Prediction, Predictions
from calib.screening.rivals.settling import (
    expected_gaps,
    inseparable,
    separations_mm,
    settled_probability,
    weights,
)

POSES = 12


def predictions(*, evidence: tuple[float, ...] = (2.0, 1.0, 0.5), far: float = 1.0, seed: int = 0) -> Predictions:
    """Three rivals with covariances of their own, at poses of which some tell more than others."""
    rng = np.random.default_rng(seed)
    size = far * np.geomspace(0.2, 2.0, POSES)[:, None]
    rivals = [
        Prediction(f"r{k}", found, size * rng.standard_normal((POSES, 3)), 0.5 * rng.standard_normal((POSES, 3, 4)))
        for k, found in enumerate(evidence)
    ]
    return Predictions(tuple(rivals), 0.05, 10_000_000)


def all_apart(count: int) -> Array:
    return ~np.eye(count, dtype=bool)


def normal(rival: Prediction, rows: Array) -> tuple[Array, Array]:
    spread = rival.spread[rows].reshape(-1, rival.spread.shape[2])
    return rival.mean[rows].ravel(), np.eye(len(spread)) + spread @ spread.T


def test_the_expected_gap_is_the_mean_log_ratio_of_what_would_be_measured() -> None:
    told = predictions()
    rows = np.array([3, 7])
    gaps = expected_gaps(told, rows)
    rng = np.random.default_rng(1)
    for i, j in ((0, 1), (2, 0)):
        mean, covariance = normal(told.rivals[i], rows)
        drawn = rng.multivariate_normal(mean, covariance, 40_000)
        ratio = multivariate_normal(mean, covariance).logpdf(drawn) - multivariate_normal(
            *normal(told.rivals[j], rows)
        ).logpdf(drawn)
        now = told.rivals[i].log_evidence - told.rivals[j].log_evidence
        error = 5.0 * ratio.std() / np.sqrt(len(ratio))
        assert gaps[i, j] == pytest.approx(now + ratio.mean(), abs=error)


def test_no_pose_leaves_the_gaps_as_they_are() -> None:
    told = predictions(evidence=(2.0, 1.0, -4.0))
    gaps = expected_gaps(told, np.zeros(0, dtype=np.int64))
    np.testing.assert_allclose(gaps, [[0, 1, 6], [-1, 0, 5], [-6, -5, 0]], atol=1e-12)
    settled = settled_probability(told, np.zeros(0, dtype=np.int64), lead=3.0)
    assert settled == 0.0


def test_the_probability_of_being_settled_is_that_of_a_lead_in_draws() -> None:
    told = predictions(far=1.5)
    rows = np.array([5, 8, 11])
    rng = np.random.default_rng(2)
    right = 0.0
    for i, likely in enumerate(weights(told)):
        drawn = rng.multivariate_normal(*normal(told.rivals[i], rows), 4000)
        after = np.array(
            [one.log_evidence + multivariate_normal(*normal(one, rows)).logpdf(drawn) for one in told.rivals]
        )
        right += likely * np.mean(after[i] - np.delete(after, i, axis=0).max(axis=0) > 3.0)
    assert settled_probability(told, rows, lead=3.0) == pytest.approx(right, abs=0.06)


def test_few_degrees_of_freedom_settle_less() -> None:
    told = predictions(far=3.0)
    rows = np.array([5, 8, 11])
    few = Predictions(told.rivals, told.sigma_mm, 6)
    assert settled_probability(few, rows) < settled_probability(told, rows)


def test_with_poses_chosen_one_more_counts_as_in_the_joint_distribution() -> None:
    """By Schur complements as by the whole covariance."""
    told = predictions()
    apart = all_apart(3)
    found = mistaken_beside(told, [2, 9], apart)
    for k in (0, 4, 11):
        gaps = expected_gaps(told, np.array([2, 9, k]))
        terms = weights(told)[:, None] * np.exp(-0.5 * gaps)
        assert found[k] == pytest.approx(np.log(terms[apart].sum()), rel=1e-9)


def test_the_choice_is_the_best_of_all() -> None:
    told = predictions()
    apart = all_apart(3)
    places = np.arange(POSES, dtype=float)[:, None] * 10.0
    chosen = choose_poses(told, 2, places=places, apart=apart)

    def mistaken(rows: tuple[int, ...]) -> float:
        terms = weights(told)[:, None] * np.exp(-0.5 * expected_gaps(told, np.array(rows)))
        return float(terms[apart].sum())

    # neighbours on the line of twelve places are the same place
    pairs = [pair for pair in combinations(range(POSES), 2) if pair[1] - pair[0] > 1]
    assert mistaken(tuple(chosen.tolist())) == pytest.approx(min(map(mistaken, pairs)))


def test_poses_at_one_place_are_taken_once() -> None:
    chosen = choose_poses(predictions(), 5, places=np.zeros((POSES, 6)), apart=all_apart(3))
    assert len(chosen) == 1


def test_exact_twins_are_told_apart_by_no_pose() -> None:
    told = predictions(far=10.0)
    first = told.rivals[0]
    twin = Prediction("twin", 1.5, first.mean, first.spread)
    together = inseparable(Predictions((first, told.rivals[1], twin), 0.05, 100))
    assert together.tolist() == [[False, False, True], [False, False, False], [True, False, False]]


def test_the_separation_is_what_a_refit_leaves() -> None:
    """A difference along what a rival can absorb is none."""
    absorbs = np.zeros((1, 3, 1))
    absorbs[0, 0, 0] = 1e4
    stiff = Prediction("stiff", 0.0, np.zeros((1, 3)), np.zeros((1, 3, 1)))

    def apart_mm(mean: list[float]) -> float:
        soft = Prediction("soft", 0.0, np.array([mean]), absorbs)
        both = Predictions((stiff, soft), 0.05, 100)
        return float(separations_mm(both, np.array([0]), all_apart(2))[0])

    assert apart_mm([40.0, 0.0, 0.0]) < 1e-3
    assert apart_mm([0.0, 40.0, 0.0]) == pytest.approx(2.0)


def test_shots_make_what_is_predicted_larger_against_the_noise() -> None:
    told = predictions()
    four = told.with_shots(4)
    np.testing.assert_allclose(four.rivals[0].mean, 2.0 * told.rivals[0].mean)
    np.testing.assert_allclose(four.rivals[0].spread, 2.0 * told.rivals[0].spread)
    assert four.sigma_mm == told.sigma_mm / 2.0
