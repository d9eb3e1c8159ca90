"""How sure further poses would make it which of several rivals is true.

The gap between two rivals is the log of their evidence's ratio. Poses not yet measured add to it what the predictions
give; where the first is true its expectation is the Kullback-Leibler divergence of the two predictive distributions,
each of a rival that is refitted at these poses too (Hunter and Reiner 1965; Box and Hill 1967; Atkinson and Fedorov
1975).
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.screening.candidates import MIN_LEAD
from calib.screening.rivals.predictions import Prediction, Predictions

_DRAWS = 400  # of what would be measured, for each rival


def weights(predictions: Predictions) -> Array:
    """(I,) how probable each rival is by its evidence now."""
    evidence = np.array([rival.log_evidence for rival in predictions.rivals])
    likely = np.exp(evidence - evidence.max())
    return np.asarray(likely / likely.sum())


def expected_gaps(predictions: Predictions, poses: IndexArray) -> Array:
    """(I, I) log evidence of the rival of the row over that of the column, expected where that of the row is true.

    poses  # (K,) that are measured besides; of those predicted
    """
    rivals = predictions.rivals
    out = np.zeros((len(rivals), len(rivals)))
    for i, j in permutations(range(len(rivals)), 2):
        now = rivals[i].log_evidence - rivals[j].log_evidence
        out[i, j] = now + _divergence(rivals[i], rivals[j], poses)
    return out


def inseparable(predictions: Predictions) -> BoolArray:
    """(I, I) pairs that all predicted poses together would not tell apart."""
    gaps = expected_gaps(predictions, np.arange(len(predictions.rivals[0].mean)))
    near = np.minimum(gaps, gaps.T) < MIN_LEAD
    return np.asarray(near & ~np.eye(len(gaps), dtype=bool))


def separations_mm(predictions: Predictions, poses: IndexArray, apart: BoolArray) -> Array:
    """(K,) by how much any two rivals that count differ at each pose at least, beyond what a refit there absorbs."""
    rivals = predictions.rivals
    least = np.full(len(poses), np.inf)
    for i, j in permutations(range(len(rivals)), 2):
        if not apart[i, j]:
            continue
        off = rivals[i].mean[poses] - rivals[j].mean[poses]
        spread = rivals[j].spread[poses]
        beyond, own = np.linalg.eigh(spread @ np.swapaxes(spread, 1, 2))  # beside the noise, which is 1
        along = np.einsum("kvw,kv->kw", own, off)
        least = np.minimum(least, np.sqrt(np.sum(along**2 / (1.0 + np.clip(beyond, 0.0, None)), axis=1)))
    return np.where(np.isfinite(least), least * predictions.sigma_mm, 0.0)


def settled_probability(predictions: Predictions, poses: IndexArray, *, lead: float = MIN_LEAD) -> float:
    """The probability that, with further poses measured, the true rival leads all others by this much log evidence.

    Averaged over which rival is true, by its evidence now, over its size, and over the noise: by draws from the
    predictive distributions.
    """
    rivals = predictions.rivals
    likely = weights(predictions)
    rng = np.random.default_rng(0)
    joint = [_joint(rival, poses) for rival in rivals]
    draws = rng.standard_normal((len(joint[0][0]), _DRAWS))
    freedom = predictions.freedom
    total = 0.0
    for i, (mean, _) in enumerate(joint):
        measured = mean[:, None] + joint[i][1] @ draws
        after = np.empty((len(joint), _DRAWS))
        for j, (predicted, root) in enumerate(joint):
            off = np.linalg.solve(root, measured - predicted[:, None])
            # The noise is estimated with each rival: a Student distribution, as the screening's evidence.
            fit = 0.5 * (freedom + len(off)) * np.log1p(np.sum(off**2, axis=0) / freedom)
            after[j] = rivals[j].log_evidence - fit - np.sum(np.log(np.diag(root)))
        others = np.delete(after, i, axis=0).max(axis=0)
        total += float(likely[i] * np.mean(after[i] - others > lead))
    return total


def _joint(rival: Prediction, poses: IndexArray) -> tuple[Array, Array]:
    """Mean (K W,), and lower triangular root (K W, K W) of the covariance, of what a rival predicts at some poses."""
    spread = rival.spread[poses].reshape(-1, rival.spread.shape[2])
    # Cholesky's factor of 1 + L L^T, without the square, in which the noise would be lost beside a wide spread.
    upper = np.asarray(np.linalg.qr(np.concatenate([np.eye(len(spread)), spread.T]), mode="r"))
    return rival.mean[poses].ravel(), (upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, None]).T


def _divergence(true: Prediction, other: Prediction, poses: IndexArray) -> float:
    """KL divergence of what one rival predicts against what another does.

    By Woodbury in the other's few parameters: (1 + L L^T)^-1 = 1 - L (1 + L^T L)^-1 L^T, for any number of poses.
    """
    own = true.spread[poses].reshape(-1, true.spread.shape[2])
    spread = other.spread[poses].reshape(-1, other.spread.shape[2])
    off = (true.mean[poses] - other.mean[poses]).ravel()
    inner = np.eye(spread.shape[1]) + spread.T @ spread
    apart = np.column_stack([own, off])
    seen = spread.T @ apart
    beyond = float(np.sum(apart**2)) - float(np.sum(seen * np.linalg.solve(inner, seen)))
    absorbed = spread.shape[1] - float(np.trace(np.linalg.inv(inner)))
    logs = np.linalg.slogdet(inner)[1] - np.linalg.slogdet(np.eye(own.shape[1]) + own.T @ own)[1]
    return 0.5 * (beyond - absorbed + float(logs))
