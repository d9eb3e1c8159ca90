"""Sizes and spreads of numbers, of vectors and of covariances; tails and quantiles of test statistics.

scipy.stats has the distributions, too, but takes a third of a second to load, as long as most of what is computed here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from calib.array_types import Array, IndexArray

_LATTICE_POINTS = 8192
_PRIMES = np.array([n for n in range(2, 542) if all(n % m for m in range(2, int(n**0.5) + 1))], dtype=float)  # 100
MAD_TO_SIGMA = 1.4826  # of normal numbers: sigma over the median of their absolute deviations


def mad_sigma(deviations: Array) -> float:
    """Sigma of normal numbers, robust to outliers, from their deviations from the middle: 1.4826 MAD."""
    return float(MAD_TO_SIGMA * np.median(np.abs(deviations)))


def mad_sigmas(values: Array) -> Array:
    """Robust sigma (n,) of each column of values (N, n) about its median: 1.4826 MAD."""
    return MAD_TO_SIGMA * np.median(np.abs(values - np.median(values, axis=0)), axis=0)


def rms(values: ArrayLike) -> float:
    """Root mean square of numbers."""
    return float(np.sqrt(np.mean(np.square(values))))


def rms_length(vectors: Array) -> float:
    """Root mean square of the lengths of vectors (N, d)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def axis_variances(covariances: Array) -> Array:
    """Variances (N,) along one axis, in the mean over all three, of errors with these covariances (N, 3, 3)."""
    return np.trace(covariances, axis1=1, axis2=2) / 3.0


def axis_sigma(covariances: Array) -> float:
    """Sigma along one axis of errors in space with these covariances (N, 3, 3), root mean square."""
    return float(np.sqrt(np.mean(np.trace(covariances, axis1=1, axis2=2)) / 3.0))


def group_numbers(keys: ArrayLike) -> IndexArray:
    """Number (N,) of each value's group, of values (N,) or rows (N, K); equal ones are a group, the least the first."""
    keys = np.asarray(keys)
    return np.unique(keys, axis=0 if keys.ndim > 1 else None, return_inverse=True)[1].reshape(-1)


def group_sums(values: Array, group: IndexArray, groups: int) -> Array:
    """Sums (G, ...) over each group of values (M, ...), zero where a group has none; `group` (M,) numbers them."""
    total = np.zeros((groups, *values.shape[1:]))
    np.add.at(total, group, values)
    return total


def group_means(values: Array, group: IndexArray, groups: int, *, empty: float = 0.0) -> Array:
    """Means (G, ...) over each group of values (M, ...), `empty` where a group has none; `group` (M,) numbers them."""
    count = np.bincount(group, minlength=groups).reshape(-1, *[1] * (values.ndim - 1))
    return np.where(count > 0, group_sums(values, group, groups) / np.maximum(count, 1), empty)


def ranks(values: Array, same: float) -> IndexArray:
    """Ranks (N,) of values; neighbours in size that differ by no more than `same` have equal rank."""
    order = np.argsort(values, kind="stable")
    out = np.empty(len(values), dtype=np.int64)
    out[order] = np.concatenate([[0], np.cumsum(np.diff(values[order]) > same)])
    return out


def left_out_by(hat: Array) -> Array:
    """Matrices 1 - H (..., n, n) whose inverses turn residuals of rows into their errors where a fit leaves them out.

    H is the rows' block of the hat matrix. Rows that alone determine a direction make 1 - H singular; a floor keeps
    their error finite.
    """
    return (1.0 + 1e-9) * np.eye(hat.shape[-1]) - hat


def covariance_root(covariance: Array) -> Array:
    """Root R (P, P) of a covariance R R^T, in any units; negative eigenvalues from rounding count as zero."""
    scale = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    inverse = np.divide(1.0, scale, out=np.zeros_like(scale), where=scale > 0.0)
    size, turn = np.linalg.eigh(inverse[:, None] * covariance * inverse)
    return scale[:, None] * turn * np.sqrt(np.clip(size, 0.0, None))


# ---- distributions ---------------------------------------------------------------------------------------------------


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
