"""Tails and quantiles of the test statistics' distributions.

scipy.stats has the same, but takes a third of a second to load, as long as most of what is computed here.
"""

from __future__ import annotations

import numpy as np
from scipy import special

from calib.array_types import Array

_LATTICE_POINTS = 8192
_PRIMES = np.array([n for n in range(2, 542) if all(n % m for m in range(2, int(n**0.5) + 1))], dtype=float)  # 100


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


def normal_cdf(upper: Array, correlation: Array) -> float:
    """P(all X_i <= upper_i) of K standard normal numbers with a correlation matrix (K, K), which may be singular.

    One variable after the other is drawn below its bound, the likeliest to exceed it first (Genz 1992), at the points
    of a fixed lattice; the mean of the products of their probabilities is good to about 1e-4. scipy's own cdf draws at
    random and takes 5 s for eight variables, where this takes 4 ms.
    """
    count = len(upper)
    if count == 1:
        return float(special.ndtr(upper[0]))
    order = np.argsort(upper, kind="stable")
    bound, rest = upper[order], correlation[np.ix_(order, order)]
    root = _root_of_singular(rest)
    # Roots of primes make a lattice (Richtmyer 1951); folded, its error falls with the points' number.
    lattice = np.arange(1, _LATTICE_POINTS + 1)[:, None] * np.sqrt(np.resize(_PRIMES, count - 1))
    uniform = np.abs(2.0 * (lattice % 1.0) - 1.0)
    drawn = np.zeros((_LATTICE_POINTS, count))
    product = np.ones(_LATTICE_POINTS)
    for k in range(count):
        room = bound[k] - drawn[:, :k] @ root[k, :k]
        determined = root[k, k] == 0.0  # by those drawn before
        share = (room >= 0.0).astype(float) if determined else special.ndtr(room / root[k, k])
        product *= share
        if k < count - 1 and not determined:
            drawn[:, k] = special.ndtri(np.clip(uniform[:, k] * share, 1e-300, 1.0 - 1e-16))
    return float(product.mean())


def _root_of_singular(covariance: Array) -> Array:
    """Lower triangular L with L L^T = `covariance` (K, K); where a number follows from those before it, L_kk is 0."""
    root = np.zeros_like(covariance)
    for k in range(len(covariance)):
        left = float(covariance[k, k] - root[k, :k] @ root[k, :k])
        if left > 1e-12:
            root[k, k] = np.sqrt(left)
            root[k + 1 :, k] = (covariance[k + 1 :, k] - root[k + 1 :, :k] @ root[k, :k]) / root[k, k]
    return root
