"""Tails and quantiles against their integrals and known values; they must not drift from scipy.stats."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from calib.statistics import chi2_ppf, chi2_sf, chi_median, f_sf

FREEDOM = st.integers(1, 2000)


@given(x=st.floats(-1.0, 1e4), freedom=FREEDOM)
def test_chi_squared_tail(x: float, freedom: int) -> None:
    assert chi2_sf(x, freedom) == pytest.approx(stats.chi2.sf(x, freedom), rel=1e-12, abs=1e-300)


@given(share=st.floats(1e-6, 1 - 1e-6), freedom=FREEDOM)
def test_chi_squared_quantile(share: float, freedom: int) -> None:
    assert chi2_ppf(share, freedom) == pytest.approx(stats.chi2.ppf(share, freedom), rel=1e-12)


@given(x=st.floats(-1.0, 1e4), above=FREEDOM, below=FREEDOM)
def test_f_tail(x: float, above: int, below: int) -> None:
    assert f_sf(x, above, below) == pytest.approx(stats.f.sf(x, above, below), rel=1e-12, abs=1e-300)


def test_values_from_tables() -> None:
    assert chi2_ppf(0.95, 3) == pytest.approx(7.814728, abs=1e-6)
    assert f_sf(4.964603, 1, 10) == pytest.approx(0.05, abs=1e-7)
    assert chi_median(2) == pytest.approx(math.sqrt(2 * math.log(2)))
