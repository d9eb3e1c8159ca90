"""Minima of smooth functions, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar, rosen, rosen_der

from calib.array_types import Array
from calib.minimisation import descend, minimum_on_line, with_differences


@pytest.mark.parametrize("seed", range(20))
def test_minimum_on_line_is_where_scipy_finds_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = rng.uniform(0.3, 3.0, 3)

    def function(v: float) -> float:
        return float(np.cos(a * v + b) + 0.1 * c * v**2)

    theirs = minimize_scalar(function, bounds=(-3.0, 2.0), method="bounded", options={"xatol": 1e-3})
    assert minimum_on_line(function, -3.0, 2.0, 1e-3) == pytest.approx(theirs.x, abs=1e-9)


def test_a_minimum_at_an_end_of_the_line_is_found_there() -> None:
    assert minimum_on_line(lambda v: v, -1.0, 2.0, 1e-4) == pytest.approx(-1.0, abs=2e-4)


@pytest.mark.parametrize("count", [2, 5, 9])
def test_descent_ends_in_the_valley_of_rosenbrock(count: int) -> None:
    start = np.full(count, -0.3)
    for function in (lambda x: (rosen(x), rosen_der(x)), with_differences(rosen)):
        value, at = descend(function, start, steps=300)
        np.testing.assert_allclose(at, minimize(rosen, start, jac=rosen_der, tol=1e-9).x, atol=2e-3)
        assert value < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_descent_rests_on_the_bounds_that_hold_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((6, 6))
    form, towards = root @ root.T + 0.1 * np.eye(6), rng.standard_normal(6)
    low, high = np.full(6, -0.3), np.full(6, 0.2)

    def function(x: Array) -> tuple[float, Array]:
        return float(0.5 * x @ form @ x - towards @ x), form @ x - towards

    theirs = minimize(function, np.zeros(6), jac=True, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)))
    value, at = descend(function, np.zeros(6), steps=100, flat=1e-8, bounds=(low, high))
    assert np.any(at == low) or np.any(at == high)
    assert value == pytest.approx(float(theirs.fun), abs=1e-6)
