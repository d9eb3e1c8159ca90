"""Tails and quantiles of the test statistics' distributions.

scipy.stats has the same, but takes a second to load, longer than most of what is asked here.
"""

from __future__ import annotations

import numpy as np
from scipy import special


def chi2_sf(x: float, freedom: float) -> float:
    """P(X > x) of chi squared."""
    return float(special.chdtrc(freedom, max(x, 0.0)))


def chi2_ppf(share: float, freedom: float) -> float:
    """The x that chi squared stays below with this probability."""
    return float(2.0 * special.gammaincinv(0.5 * freedom, share))


def chi_median(freedom: float) -> float:
    """Median of the chi distribution: of the length of a vector of `freedom` standard normal numbers."""
    return float(np.sqrt(chi2_ppf(0.5, freedom)))


def f_sf(x: float, above: float, below: float) -> float:
    """P(X > x) of the F distribution; degrees of freedom of numerator and denominator."""
    return float(special.fdtrc(above, below, max(x, 0.0)))
