"""How often the most striking of many kinds of change would be as striking where nothing changed.

Kinds overlap, so that a sum over them (Bonferroni) counts most chances several times; drawing the residual of an
unchanged cell counts each once. The usual kinds have most of the alarm rate: each p-value is divided by the kind's
weight before the least of them is taken (weighted Bonferroni: Genovese, Roeder, Wasserman 2006).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from calib.array_types import Array
from calib.monitoring.kinds import JIG, JOINT_ZERO, SCANNER, TOOL, ChangeModel

USUAL = (SCANNER, JOINT_ZERO, TOOL, JIG)
UNUSUAL_WEIGHT = 0.05  # of a length, an angle, a compliance: parts wear and slip more often than they bend
DRAWS = 10_000
_SURE = 1e-4  # from here on the bound by the sum is told, draws are too few


def weight(kind: ChangeModel) -> float:
    """The weight of a kind's p-value."""
    return 1.0 if kind.what in USUAL else UNUSUAL_WEIGHT


def chance_of_least(bases: Sequence[Array], weights: Sequence[float], least: float, noise_freedom: float) -> float:
    """P(the least weighted p-value of all kinds is at most `least`) where nothing changed.

    bases: of each kind the orthonormal columns (R, K) of what it makes of whitened residuals (R,).
    """
    by_sum = min(1.0, least * float(np.sum(weights)))
    if not bases or by_sum < _SURE:
        return by_sum
    rng = np.random.default_rng(0)
    counts = np.array([basis.shape[1] for basis in bases])
    # What they span has few rows, however many poses there are.
    joint = np.asarray(np.linalg.qr(np.concatenate(bases, axis=1), mode="r"))
    drawn = joint.T @ rng.standard_normal((len(joint), DRAWS))
    gains = np.add.reduceat(drawn**2, np.cumsum([0, *counts[:-1]]), axis=0)
    freedom = min(noise_freedom, 1e9)
    gains /= rng.chisquare(freedom, DRAWS) / freedom
    exceeds = np.zeros(DRAWS, dtype=bool)
    for count, share, gain in zip(counts, weights, gains, strict=True):
        level = min(least * share, 1.0)
        exceeds |= gain >= count * special.fdtri(count, freedom, 1.0 - level)
    return float(min(by_sum, (1 + exceeds.sum()) / (1 + DRAWS)))
