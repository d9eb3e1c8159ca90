"""Tails and quantiles of the test statistics' distributions.

scipy.stats has the same, but takes a second to load, longer than most of what is computed here.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from calib.array_types import Array


def chi2_sf(x: float, dof: float) -> float:
    """P(X > x) of the chi-squared distribution with `dof` degrees of freedom."""
    return float(special.chdtrc(dof, max(x, 0.0)))


def chi2_ppf(share: float, dof: float) -> float:
    """Quantile of the chi-squared distribution: the x with P(X <= x) = `share`, for `dof` degrees of freedom."""
    return float(2.0 * special.gammaincinv(0.5 * dof, share))


def chi_median(dof: float) -> float:
    """Median of the chi distribution, the length of a vector of `dof` standard normal numbers."""
    return float(np.sqrt(chi2_ppf(0.5, dof)))


def f_sf(x: float, above: float, below: float) -> float:
    """P(X > x) of the F distribution with `above` and `below` degrees of freedom; `below` may be inf."""
    if below == float("inf"):
        return float(special.chdtrc(above, above * max(x, 0.0)))
    return float(special.fdtrc(above, below, max(x, 0.0)))


def hypergeometric_sf(population: int, cases: int) -> Array:
    """Table (population + 1, cases + 1) of P(at least k cases among w drawn without replacement).

    Rows are w, columns k; Fisher's exact test of a group of w with k cases is one entry (one-sided).
    """
    drawn, found = np.mgrid[0 : population + 1, 0 : cases + 1].astype(float)

    def log_choose(n: Array | float, k: Array) -> Array:
        with np.errstate(invalid="ignore"):
            ways = special.gammaln(n + 1.0) - special.gammaln(k + 1.0) - special.gammaln(n - k + 1.0)
        return np.asarray(np.where((k < 0.0) | (k > n), -np.inf, ways))

    log_p = log_choose(float(cases), found) + log_choose(float(population - cases), drawn - found)
    p = np.exp(log_p - log_choose(float(population), drawn))
    return np.asarray(np.minimum(np.cumsum(p[:, ::-1], axis=1)[:, ::-1], 1.0))
