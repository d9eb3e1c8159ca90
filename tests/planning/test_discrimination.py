"""Discrimination by new poses: log Bayes factors against formulas, power against draws, the choice against all."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib.array_types import Array
from calib.planning.discrimination import (
    choose_poses,
    equivalent_pairs,
    expected_log_bayes_factors,
    log_confusion,
    power,
    probabilities,
    separations_mm,
)
from calib.planning.effect_hypotheses import HypothesisPrediction, HypothesisPredictions

POSES = 12


def predictions(
    *, evidence: tuple[float, ...] = (2.0, 1.0, 0.5), far: float = 1.0, seed: int = 0
) -> HypothesisPredictions:
    """Three hypotheses with covariances of their own, at poses of which some tell more than others."""
    rng = np.random.default_rng(seed)
    size = far * np.geomspace(0.2, 2.0, POSES)[:, None]
    hypotheses = [
        HypothesisPrediction(
            f"r{k}", found, size * rng.standard_normal((POSES, 3)), 0.5 * rng.standard_normal((POSES, 3, 4))
        )
        for k, found in enumerate(evidence)
    ]
    return HypothesisPredictions(tuple(hypotheses), 0.05, 10_000_000)


def all_apart(count: int) -> Array:
    return ~np.eye(count, dtype=bool)


def normal(hypothesis: HypothesisPrediction, rows: Array) -> tuple[Array, Array]:
    spread = hypothesis.spread[rows].reshape(-1, hypothesis.spread.shape[2])
    return hypothesis.mean[rows].ravel(), np.eye(len(spread)) + spread @ spread.T


def test_the_expected_log_bayes_factor_is_the_mean_over_what_would_be_measured() -> None:
    predicted = predictions()
    rows = np.array([3, 7])
    expected = expected_log_bayes_factors(predicted, rows)
    rng = np.random.default_rng(1)
    for i, j in ((0, 1), (2, 0)):
        mean, covariance = normal(predicted.hypotheses[i], rows)
        drawn = rng.multivariate_normal(mean, covariance, 40_000)
        ratio = multivariate_normal(mean, covariance).logpdf(drawn) - multivariate_normal(
            *normal(predicted.hypotheses[j], rows)
        ).logpdf(drawn)
        now = predicted.hypotheses[i].log_evidence - predicted.hypotheses[j].log_evidence
        error = 5.0 * ratio.std() / np.sqrt(len(ratio))
        assert expected[i, j] == pytest.approx(now + ratio.mean(), abs=error)


def test_no_pose_leaves_the_log_bayes_factors_as_they_are() -> None:
    predicted = predictions(evidence=(2.0, 1.0, -4.0))
    expected = expected_log_bayes_factors(predicted, np.zeros(0, dtype=np.int64))
    np.testing.assert_allclose(expected, [[0, 1, 6], [-1, 0, 5], [-6, -5, 0]], atol=1e-12)
    reached = power(predicted, np.zeros(0, dtype=np.int64), log_bayes_factor=3.0)
    assert reached == 0.0


def test_power_is_the_share_of_draws_in_which_the_true_hypothesis_leads() -> None:
    predicted = predictions(far=1.5)
    rows = np.array([5, 8, 11])
    rng = np.random.default_rng(2)
    right = 0.0
    for i, likely in enumerate(probabilities(predicted)):
        drawn = rng.multivariate_normal(*normal(predicted.hypotheses[i], rows), 4000)
        after = np.array(
            [one.log_evidence + multivariate_normal(*normal(one, rows)).logpdf(drawn) for one in predicted.hypotheses]
        )
        right += likely * np.mean(after[i] - np.delete(after, i, axis=0).max(axis=0) > 3.0)
    assert power(predicted, rows, log_bayes_factor=3.0) == pytest.approx(right, abs=0.06)


def test_few_degrees_of_freedom_have_less_power() -> None:
    predicted = predictions(far=3.0)
    rows = np.array([5, 8, 11])
    few = HypothesisPredictions(predicted.hypotheses, predicted.sigma_mm, 6)
    assert power(few, rows) < power(predicted, rows)


def test_with_poses_chosen_one_more_counts_as_in_the_joint_distribution() -> None:
    """By Schur complements as by the whole covariance."""
    predicted = predictions()
    apart = all_apart(3)
    found = log_confusion(predicted, [2, 9], apart)
    for k in (0, 4, 11):
        expected = expected_log_bayes_factors(predicted, np.array([2, 9, k]))
        terms = probabilities(predicted)[:, None] * np.exp(-0.5 * expected)
        assert found[k] == pytest.approx(np.log(terms[apart].sum()), rel=1e-9)


def test_the_choice_is_the_best_of_all() -> None:
    predicted = predictions()
    apart = all_apart(3)
    places = np.arange(POSES, dtype=float)[:, None] * 10.0
    chosen = choose_poses(predicted, 2, places=places, pairs=apart)

    def mistaken(rows: tuple[int, ...]) -> float:
        terms = probabilities(predicted)[:, None] * np.exp(-0.5 * expected_log_bayes_factors(predicted, np.array(rows)))
        return float(terms[apart].sum())

    # neighbours on the line of twelve places are the same place
    pairs = [pair for pair in combinations(range(POSES), 2) if pair[1] - pair[0] > 1]
    assert mistaken(tuple(chosen.tolist())) == pytest.approx(min(map(mistaken, pairs)))


def test_poses_at_one_place_are_taken_once() -> None:
    chosen = choose_poses(predictions(), 5, places=np.zeros((POSES, 6)), pairs=all_apart(3))
    assert len(chosen) == 1


def test_equivalent_hypotheses_are_discriminated_by_no_pose() -> None:
    predicted = predictions(far=10.0)
    first = predicted.hypotheses[0]
    same = HypothesisPrediction("same", 1.5, first.mean, first.spread)
    together = equivalent_pairs(HypothesisPredictions((first, predicted.hypotheses[1], same), 0.05, 100))
    assert together.tolist() == [[False, False, True], [False, False, False], [True, False, False]]


def test_the_separation_is_what_a_refit_leaves() -> None:
    """A difference along what a hypothesis can absorb is none."""
    absorbs = np.zeros((1, 3, 1))
    absorbs[0, 0, 0] = 1e4
    stiff = HypothesisPrediction("stiff", 0.0, np.zeros((1, 3)), np.zeros((1, 3, 1)))

    def apart_mm(mean: list[float]) -> float:
        soft = HypothesisPrediction("soft", 0.0, np.array([mean]), absorbs)
        both = HypothesisPredictions((stiff, soft), 0.05, 100)
        return float(separations_mm(both, np.array([0]), all_apart(2))[0])

    assert apart_mm([40.0, 0.0, 0.0]) < 1e-3
    assert apart_mm([0.0, 40.0, 0.0]) == pytest.approx(2.0)
