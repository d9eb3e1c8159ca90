"""Information of poses, and the best few of many: laws, and all subsets of a small case gone through."""

from itertools import combinations

import numpy as np
import pytest

from calib.errors import CalibError
from calib.planning.exchange import OptimalityCriterion, best_poses, condensed, inverse


def drawn(seed: int, n: int = 16, k: int = 6) -> OptimalityCriterion:
    """Candidates of unequal worth about a few unknowns, of which four sums matter."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((n, 3, k)) * rng.uniform(0.3, 2.0, (n, 1, 1)) * rng.uniform(0.2, 2.0, k)
    return OptimalityCriterion(rows, 0.05 * np.eye(k), rng.standard_normal((k, 4)))


def with_rows(question: OptimalityCriterion, rows: list[int]) -> np.ndarray:
    flat = question.rows[rows].reshape(-1, question.prior_information.shape[0])
    return question.prior_information + flat.T @ flat


def test_a_candidates_worth_is_that_of_its_information_added() -> None:
    question = drawn(0)
    fast = question.log_values_with(question.prior_information)
    slow = [question.log_value(with_rows(question, [i])) for i in range(len(question.rows))]
    np.testing.assert_allclose(fast, slow, atol=1e-9)
    assert np.all(fast < question.log_value(question.prior_information))  # whatever is measured, no less is known


@pytest.mark.parametrize("seed", range(4))
def test_the_exchange_is_within_2_percent_of_the_best_of_all_subsets(seed: int) -> None:
    question = drawn(seed, n=14)
    every = [question.log_value(with_rows(question, list(s))) for s in combinations(range(14), 4)]
    choice = best_poses([question], 4)
    assert choice.log_value <= min(every) + np.log(1.02)
    assert choice.log_value <= choice.greedy_log_values[-1] + 1e-12
    assert choice.log_value == pytest.approx(question.log_value(with_rows(question, choice.rows.tolist())))


def test_the_order_of_the_candidates_changes_nothing() -> None:
    question = drawn(1, n=30)
    order = np.random.default_rng(5).permutation(30)
    shuffled = OptimalityCriterion(question.rows[order], question.prior_information, question.target_combinations)
    one, other = best_poses([question], 6), best_poses([shuffled], 6)
    assert [int(order[i]) for i in other.rows] == one.rows.tolist()


def test_excluded_candidates_are_not_chosen() -> None:
    question = drawn(2)
    free = best_poses([question], 3).rows
    choice = best_poses([question], 3, exclude=np.isin(np.arange(16), free[:1]))
    assert free[0] not in choice.rows
    with pytest.raises(CalibError, match="found 2 candidates for 3 poses"):
        best_poses([question], 3, exclude=np.arange(16) > 1)


def test_poses_are_shared_among_several_questions() -> None:
    """Two questions that different candidates answer count alike, however much easier one of them is."""
    rng = np.random.default_rng(3)
    rows = 0.01 * rng.standard_normal((20, 3, 2))
    rows[:10, 0, 0] += 3.0
    rows[10:, 0, 1] += 0.5
    easy, hard = (OptimalityCriterion(rows, np.eye(2) * 1e-3, np.eye(2)[:, [k]]) for k in (0, 1))
    assert np.sum(best_poses([easy, hard], 6).rows >= 10) == 3


def test_many_sums_are_condensed_without_loss() -> None:
    rng = np.random.default_rng(4)
    wanted = rng.standard_normal((5, 60))
    covariance = inverse(np.eye(5) + np.diag(np.arange(5.0)))
    few = condensed(wanted)
    assert few.shape == (5, 5)
    assert np.trace(few.T @ covariance @ few) == pytest.approx(np.trace(wanted.T @ covariance @ wanted))


def test_unknowns_that_nothing_bounds_are_refused() -> None:
    with pytest.raises(CalibError, match="plan with the prior"):
        inverse(np.ones((2, 2)))
