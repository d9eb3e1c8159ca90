"""The poses that tell rivals apart: chosen one by one, then exchanged.

What is made small is how easily one rival is mistaken for another, summed over all ordered pairs,

    sum over i of w_i sum over j of exp(-gap_ij / 2),

w_i the probability of rival i and gap_ij the log evidence that it would have over rival j were it true. The least gap
rules the sum, and a pair that is told apart already has no say.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.screening.rivals.predictions import Prediction, Predictions
from calib.screening.rivals.settling import weights

_NEAR = 0.1  # of a joint's range: poses that are nearer than this in every joint count as the same place
_ROUNDS = 3  # of exchanges


def choose_poses(predictions: Predictions, count: int, *, places: Array, apart: BoolArray) -> IndexArray:
    """(count,) of the predicted poses, in the order chosen; fewer where they run out.

    Args:
        predictions: of C poses.
        count: how many to choose.
        places: (C, n) joints; poses at nearly the same place are not taken twice.
        apart: (I, I) pairs of rivals that count.
    """
    chosen = grown((), predictions, count, places=places, apart=apart).tolist()
    for _ in range(_ROUNDS if len(chosen) > 1 else 0):
        before = list(chosen)
        for k in range(len(chosen)):
            best = _best_beside(predictions, [*chosen[:k], *chosen[k + 1 :]], places, apart)
            chosen[k] = chosen[k] if best is None else best
        if chosen == before:
            break
    return np.array(chosen, dtype=np.int64)


def grown(start: Sequence[int], predictions: Predictions, count: int, *, places: Array, apart: BoolArray) -> IndexArray:
    """Chosen poses with more, each the best beside those before it, up to `count`."""
    chosen = list(start)
    while len(chosen) < count:
        best = _best_beside(predictions, chosen, places, apart)
        if best is None:
            break
        chosen.append(best)
    return np.array(chosen, dtype=np.int64)


def _best_beside(predictions: Predictions, chosen: Sequence[int], places: Array, apart: BoolArray) -> int | None:
    """The pose that leaves the least to be mistaken beside those that are chosen; None where none is free."""
    span = np.maximum(np.ptp(places, axis=0), 1e-9)
    free = np.ones(len(places), dtype=bool)
    for k in chosen:
        free &= np.max(np.abs(places - places[k]) / span, axis=1) > _NEAR
    if not free.any():
        return None
    return int(np.argmin(np.where(free, mistaken_beside(predictions, chosen, apart), np.inf)))


def mistaken_beside(predictions: Predictions, chosen: Sequence[int], apart: BoolArray) -> Array:
    """(C,) log of the sum over pairs, with the chosen poses and one more."""
    rivals = predictions.rivals
    given = [_Conditional(rival, chosen) for rival in rivals]
    terms = []
    for i, j in permutations(range(len(rivals)), 2):
        if apart[i, j]:
            now = rivals[i].log_evidence - rivals[j].log_evidence
            gap = now + given[j].divergence_from(given[i])
            terms.append(np.log(weights(predictions)[i]) - 0.5 * gap)
    return np.asarray(np.logaddexp.reduce(np.stack(terms), axis=0))


class _Conditional:
    """One rival's prediction at every pose, given those at the chosen ones, by Schur complements."""

    def __init__(self, rival: Prediction, chosen: Sequence[int]) -> None:
        self.rival = rival
        spread = rival.spread
        self.inside = spread[list(chosen)].reshape(-1, spread.shape[2])  # (S, P)
        self.mean_inside = rival.mean[list(chosen)].ravel()
        self.covariance = np.eye(len(self.inside)) + self.inside @ self.inside.T
        # By the singular values of the inside, so that nothing cancels where a rival spreads far beyond the noise.
        axes, size, turn = np.linalg.svd(self.inside, full_matrices=False)
        self.inverse_inside = np.eye(len(axes)) - (axes * (size**2 / (1.0 + size**2))) @ axes.T
        along = spread @ turn.T  # (C, W, k)
        self.gain = (along * (size / (1.0 + size**2))) @ axes.T
        root = spread - (along * (1.0 - 1.0 / np.sqrt(1.0 + size**2))) @ turn
        beyond, own = np.linalg.eigh(root @ np.swapaxes(root, 1, 2))  # beside the noise, which is 1
        beyond = np.clip(beyond, 0.0, None)
        self.inverse = (own / (1.0 + beyond)[:, None, :]) @ np.swapaxes(own, 1, 2)
        self.log_det = np.sum(np.log1p(beyond), axis=1) + np.sum(np.log1p(size**2))

    def divergence_from(self, true: _Conditional) -> Array:
        """(C,) KL divergence of the true rival's joint prediction, chosen poses and one more, against this one's."""
        off_inside = true.mean_inside - self.mean_inside
        inside = np.sum(self.inverse_inside * true.covariance) + off_inside @ self.inverse_inside @ off_inside
        off = true.rival.mean - self.rival.mean - self.gain @ off_inside
        spread = true.rival.spread - self.gain @ true.inside
        seen = self.gain @ np.swapaxes(self.gain, 1, 2) + spread @ np.swapaxes(spread, 1, 2)
        beside = np.einsum("cij,cji->c", self.inverse, seen + np.eye(off.shape[1]))
        apart = np.einsum("ci,cij,cj->c", off, self.inverse, off)
        rows = off.shape[1] + len(off_inside)
        return np.asarray(0.5 * (inside + beside + apart - rows + self.log_det - true.log_det))
