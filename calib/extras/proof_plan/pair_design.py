"""Choice of pairs of poses whose differences under a changed condition prove what moves the arm.

A cause is proven where no other one explains the differences nearly as well (`calib.intervention.proof`). With S the
squared size of a cause's differences, in sigmas, of which the best rival explains the share R^2, the log likelihood
ratio has the mean d^2 / 2 and the standard deviation d, d^2 = S (1 - R^2). The probability that this ratio is above
`MIN_LEAD` is what the chosen pairs are worth; they are chosen by exp(-d^2 / 4), averaged over the causes that are
thought of, which falls from the first pair on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from calib.array_types import Array, IndexArray
from calib.intervention.differences import Differences
from calib.intervention.proof import MIN_LEAD, PairCandidate
from calib.planning.question import OptimalityCriterion

_FREE = 1e-7  # share of the nuisance's own information that keeps it invertible


@dataclass(frozen=True, kw_only=True)
class PairQuestion(OptimalityCriterion):
    """Which of C pairs prove one of T causes; its unknowns are the nuisance, then the candidates' parameters.

    The target combinations are the causes: coefficients (K, T), of one candidate each.
    """

    owner: IndexArray  # (K,) number of the candidate that has each parameter; -1 of instrument and tool

    @classmethod
    def of(cls, rows: Array, owner: IndexArray, causes: Array) -> PairQuestion:
        """The criterion of pairs with rows (C, 3, K), and causes (T, P) by the last P parameters."""
        k = len(owner)
        combinations = np.zeros((k, len(causes)))
        combinations[k - causes.shape[1] :] = causes.T
        return cls(rows=rows, prior_information=np.zeros((k, k)), target_combinations=combinations, owner=owner)

    @classmethod
    def of_differences(
        cls, differences: Differences, candidates: Sequence[PairCandidate], causes: Array
    ) -> PairQuestion:
        """The criterion whose pairs are the places of given differences."""
        columns = np.concatenate([differences.nuisance, *(c.columns for c in candidates)], axis=1)
        cell = np.repeat(differences.cell, 3)
        rows = [columns[cell == k] for k in range(int(cell.max()) + 1)]
        widths = [differences.nuisance.shape[1], *(c.columns.shape[1] for c in candidates)]
        return cls.of(np.stack(rows), np.repeat(np.arange(-1, len(candidates)), widths), causes)

    def log_value(self, information: Array) -> float:
        """Log of the criterion for an information matrix (K, K)."""
        return float(self._log_confusion(information[None])[0])

    def log_values_with(self, information: Array) -> Array:
        """Log of the criterion (C,) with each one of the pairs added to an information matrix (K, K)."""
        return self._log_confusion(information + np.swapaxes(self.rows, 1, 2) @ self.rows)

    def probability_of(self, chosen: IndexArray) -> float:
        """Probability, nearly, that the true cause is proven by some of the pairs."""
        rows = self.rows[chosen].reshape(-1, len(self.owner))
        apart = np.sqrt(self._beyond_rivals((rows.T @ rows)[None])[0])
        return float(ndtr((0.5 * apart**2 - MIN_LEAD) / apart).mean())

    def _log_confusion(self, information: Array) -> Array:
        return np.asarray(np.log(np.exp(-0.25 * self._beyond_rivals(information)).mean(axis=1)))

    def _beyond_rivals(self, information: Array) -> Array:
        """Squared size d^2 (C, T), in sigmas, of what no rival explains of each cause."""
        visible, causes = self._visible(information), self.target_combinations[self.owner >= 0]
        owner = self.owner[self.owner >= 0]
        along = visible @ causes  # (C, P, T)
        square = np.einsum("kt,ckt->ct", causes, along)
        explained = np.zeros_like(square)
        own = owner[np.argmax(causes != 0.0, axis=0)]
        for number in range(int(owner.max()) + 1):
            k = np.flatnonzero(owner == number)
            block = visible[:, k[:, None], k]
            size = np.einsum("ckk->ck", block).mean(axis=1)[:, None, None]
            block = block + (1e-6 * size + 1e-12) * np.eye(len(k))
            by_rival = np.einsum("ckt,ckt->ct", along[:, k], np.linalg.solve(block, along[:, k]))
            explained = np.maximum(explained, np.where(own == number, 0.0, by_rival))
        return np.maximum(square - explained, 1e-9)

    def _visible(self, information: Array) -> Array:
        """Information (C, P, P) on the candidates' parameters, with the nuisance unknown."""
        n = int(np.sum(self.owner < 0))
        size = np.sqrt(np.maximum(np.einsum("ckk->ck", information[:, :n, :n]), 1e-12))
        own = information[:, :n, :n] / size[:, :, None] / size[:, None, :] + _FREE * np.eye(n)
        across = information[:, :n, n:] / size[:, :, None]
        return information[:, n:, n:] - np.swapaxes(across, 1, 2) @ np.linalg.solve(own, across)
