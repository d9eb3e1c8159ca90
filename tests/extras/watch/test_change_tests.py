"""Family-wise p-value of the most significant of many tests, against draws and bounds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from calib.extras.watch.change_tests import family_wise_p_value


def test_one_change_has_its_own_p_value_and_many_apart_have_their_sum() -> None:
    basis = np.eye(24)
    assert family_wise_p_value([basis[:, :1]], [1.0], 0.01, 1e9) == pytest.approx(0.01, rel=0.3)
    apart = [basis[:, [k]] for k in range(10)]
    assert family_wise_p_value(apart, [1.0] * 10, 0.004, 200.0) == pytest.approx(1 - 0.996**10, rel=0.2)


def test_changes_that_are_the_same_count_once() -> None:
    same = [np.eye(24)[:, :3]] * 20
    assert family_wise_p_value(same, [1.0] * 20, 0.01, 1e9) == pytest.approx(0.01, rel=0.3)


def test_a_small_weight_takes_little_of_the_rate() -> None:
    basis = np.eye(24)
    bases = [basis[:, :1], *(basis[:, [k]] for k in range(1, 21))]
    rate = family_wise_p_value(bases, [1.0] + [0.05] * 20, 0.01, 1e9)
    assert rate == pytest.approx(0.02, rel=0.25)


def test_it_is_the_rate_that_draws_of_another_kind_have() -> None:
    rng = np.random.default_rng(3)
    bases = [np.linalg.qr(rng.normal(size=(24, k)))[0] for k in (1, 1, 3, 6)]
    y = rng.normal(size=(24, 40_000))
    least = np.min([chi2.sf(np.sum((b.T @ y) ** 2, axis=0), b.shape[1]) for b in bases], axis=0)
    level = float(np.quantile(least, 0.02))
    assert family_wise_p_value(bases, [1.0] * 4, level, 1e9) == pytest.approx(0.02, rel=0.25)
