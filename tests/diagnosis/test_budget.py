"""The error budget: shares that sum to 1 and are the falls of the test error, whatever the order of the errors."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.calibration.noise_level import DECLARED, FIT, NoiseLevel
from calib.diagnosis.budget import LINKS, NOISE, UNKNOWN, ErrorBudget, budget_of_stages
from calib.diagnosis.headline import ErrorStage, Headline
from calib.present.fit.errors import error_headline

EFFECTS = ("backlash", "joint_compliance", "tool_sag", "joint_dent", "link_bending")


def headline(*errors_mm: float, noise_mm: float = 0.05, source: str = DECLARED) -> Headline:
    """Headline of errors from the arm as delivered on, each stage after the links with one effect."""
    stages = [ErrorStage("as delivered", errors_mm[0], None)]
    for k, error_mm in enumerate(errors_mm[1:]):
        stages.append(ErrorStage("with", error_mm, k, () if k == 0 else (EFFECTS[k - 1],)))
    return Headline(tuple(stages), NoiseLevel(noise_mm / math.sqrt(3.0), source, 1.0), of_test_poses=True)


def budget(*errors_mm: float, noise_mm: float = 0.05, source: str = DECLARED) -> ErrorBudget:
    found = budget_of_stages(headline(*errors_mm, noise_mm=noise_mm, source=source))
    assert found is not None
    return found


def shares(found: ErrorBudget) -> dict[str, float]:
    return {one.cause: one.share for one in found.shares}


LENGTH = st.floats(1e-3, 1e3)


@given(st.lists(LENGTH, min_size=2, max_size=6), LENGTH, st.sampled_from([DECLARED, FIT]))
def test_shares_are_positive_and_sum_to_one(errors_mm: list[float], noise_mm: float, source: str) -> None:
    found = budget(*errors_mm, noise_mm=noise_mm, source=source)
    assert all(one.share > 0.0 for one in found.shares)
    assert sum(one.share for one in found.shares) == pytest.approx(1.0)
    assert sum(one.mm**2 for one in found.shares) == pytest.approx(errors_mm[0] ** 2)
    assert (NOISE in shares(found)) == (source == DECLARED)


def test_each_cause_has_the_fall_of_its_step_and_the_rest_is_noise_and_unknown() -> None:
    found = shares(budget(10.0, 2.0, 1.0, noise_mm=0.5))
    assert found == pytest.approx({LINKS: 0.96, "backlash": 0.03, NOISE: 0.0025, UNKNOWN: 0.0075})


def test_a_rise_is_taken_off_the_gains_before_it_and_told() -> None:
    found = budget(10.0, 2.0, 3.0, 1.0, noise_mm=1.0)
    assert found.raised == ("backlash",)
    assert shares(found) == pytest.approx({LINKS: 0.91, "joint_compliance": 0.08, NOISE: 0.01})
    worse = budget(1.0, 2.0, noise_mm=0.1)
    assert worse.raised == (LINKS,)
    assert shares(worse) == pytest.approx({NOISE: 0.01, UNKNOWN: 0.99})


def test_an_error_below_the_noise_is_all_noise() -> None:
    assert shares(budget(1.0, 0.1, noise_mm=0.2)) == pytest.approx({LINKS: 0.99, NOISE: 0.01})


def test_noise_that_only_the_fit_shows_is_not_told_from_the_unknown() -> None:
    found = budget(1.0, 0.1, source=FIT)
    assert not found.noise_is_known
    assert shares(found) == pytest.approx({LINKS: 0.99, UNKNOWN: 0.01})


def test_there_is_none_without_an_error_as_delivered() -> None:
    assert budget_of_stages(headline(0.0, 0.0)) is None
    assert budget_of_stages(headline(math.nan, math.nan)) is None
    assert budget_of_stages(headline(1.0)) is None


def test_what_is_as_small_as_noise_and_yet_unexplained_is_not_called_noise() -> None:
    small = headline(1.0, 0.05)
    assert small.reached_noise
    assert "no more than noise" in error_headline(small).note
    told = error_headline(small, unexplained=True)
    assert "the verdict says why not all of it is" in told.note
    assert not told.good
