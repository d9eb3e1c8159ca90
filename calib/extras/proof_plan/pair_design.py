"""Choice of pairs of poses whose differences under a changed condition prove what moves the arm.

A cause is proven where no other one explains the differences nearly as well (`calib.intervention.proof`). With S the
squared size of a cause's differences, in sigmas, of which the best rival explains the share R^2, the log likelihood
ratio has the mean d^2 / 2 and the standard deviation d, d^2 = S (1 - R^2). Pairs are chosen so that the probability
that this ratio is above `MIN_LEAD`, averaged over the causes that are thought of, is as high as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.intervention.differences import Differences
from calib.intervention.proof import MIN_LEAD, PairCandidate

_SWEEPS = 3  # of exchanges over all chosen pairs
_WORTH_A_SWEEP = 0.01  # of the probability, that a sweep has to gain for another one
_GAIN = 1e-4  # of the probability, below which an exchange is rounding
_FREE = 1e-7  # share of the nuisance's own information that keeps it invertible


@dataclass(frozen=True)
class PairDesign:
    """Information of C pairs on nuisance and candidate effects, and the causes of which one is to be proven."""

    information: Array  # (C, K, K) of the nuisance, then of the candidates' parameters
    nuisance: int  # number of columns that are instrument and tool
    owner: IndexArray  # (K - nuisance,) number of the candidate that has each parameter
    causes: Array  # (T, K - nuisance) coefficients of each cause, of one candidate each

    @classmethod
    def of(cls, differences: Differences, candidates: Sequence[PairCandidate], causes: Array) -> PairDesign:
        """Design whose pairs are the places of given differences."""
        columns = np.concatenate([differences.nuisance, *(c.columns for c in candidates)], axis=1)
        cell = np.repeat(differences.cell, 3)
        of_place = [columns[cell == k] for k in range(int(cell.max()) + 1)]
        owner = np.repeat(np.arange(len(candidates)), [c.columns.shape[1] for c in candidates])
        information = np.stack([rows.T @ rows for rows in of_place])
        return cls(information, differences.nuisance.shape[1], owner, causes)

    def probability(self, information: Array) -> Array:
        """Probability (C,), nearly, that the true cause is proven, for information (C, K, K) of chosen pairs."""
        apart = np.sqrt(self._beyond_rivals(information))
        return np.asarray(ndtr((0.5 * apart**2 - MIN_LEAD) / apart).mean(axis=1))

    def probability_of(self, chosen: IndexArray) -> float:
        """Probability, nearly, that the true cause is proven by some of the pairs."""
        return float(self.probability(self.information[chosen].sum(axis=0)[None])[0])

    def confusion(self, information: Array) -> Array:
        """Criterion (C,) that falls from the first pair on: exp(-d^2 / 4), averaged over the causes."""
        return np.asarray(np.exp(-0.25 * self._beyond_rivals(information)).mean(axis=1))

    def _beyond_rivals(self, information: Array) -> Array:
        """Squared size d^2 (C, T), in sigmas, of what no rival explains of each cause."""
        visible = self._visible(information)
        along = visible @ self.causes.T  # (C, K, T)
        square = np.einsum("tk,ckt->ct", self.causes, along)
        explained = np.zeros_like(square)
        own = np.array([self.owner[np.flatnonzero(cause)[0]] for cause in self.causes])
        for number in range(int(self.owner.max()) + 1):
            k = np.flatnonzero(self.owner == number)
            block = visible[:, k[:, None], k]
            size = np.einsum("ckk->ck", block).mean(axis=1)[:, None, None]
            block = block + (1e-6 * size + 1e-12) * np.eye(len(k))
            by_rival = np.einsum("ckt,ckt->ct", along[:, k], np.linalg.solve(block, along[:, k]))
            explained = np.maximum(explained, np.where(own == number, 0.0, by_rival))
        return np.maximum(square - explained, 1e-9)

    def _visible(self, information: Array) -> Array:
        """Information (C, K, K) on the candidates' parameters, with the nuisance unknown."""
        n = self.nuisance
        size = np.sqrt(np.maximum(np.einsum("ckk->ck", information[:, :n, :n]), 1e-12))
        own = information[:, :n, :n] / size[:, :, None] / size[:, None, :] + _FREE * np.eye(n)
        across = information[:, :n, n:] / size[:, :, None]
        return information[:, n:, n:] - np.swapaxes(across, 1, 2) @ np.linalg.solve(own, across)


@one_blas_thread()
def greedy_pairs(design: PairDesign, count: int) -> IndexArray:
    """Indices (count,) of pairs, each the one that tells most given those before; fewer if there are not enough."""
    each = design.information
    free = np.ones(len(each), dtype=bool)
    chosen: list[int] = []
    total = np.zeros(each.shape[1:])
    for _ in range(min(count, len(each))):
        best = int(np.argmin(np.where(free, design.confusion(total + each), np.inf)))
        chosen.append(best)
        free[best] = False
        total = total + each[best]
    return np.array(chosen, dtype=np.int64)


@one_blas_thread()
def exchanged_pairs(design: PairDesign, chosen: IndexArray) -> IndexArray:
    """Chosen pairs, each exchanged for another one where that proves the true cause more probably."""
    each, rows = design.information, chosen.tolist()
    free = np.ones(len(each), dtype=bool)
    free[rows] = False
    total = each[rows].sum(axis=0)
    value = float(design.probability(total[None])[0])
    for _ in range(_SWEEPS):
        before = value
        for k, given_up in enumerate(rows):
            without = total - each[given_up]
            values = np.where(free, design.probability(without + each), -1.0)
            best = int(np.argmax(values))
            if values[best] > value + _GAIN:
                free[given_up], free[best] = True, False
                rows[k], total, value = best, without + each[best], float(values[best])
        if value < before + _WORTH_A_SWEEP:
            break
    return np.array(rows, dtype=np.int64)
