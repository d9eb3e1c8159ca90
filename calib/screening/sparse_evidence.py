"""Evidence of an effect that acts at one of hundreds of possible places (a step, a dent), few of which are active.

The formulas are those of `calib.screening.evidence.evaluate_family`, for all members at once: a member's K columns
enter by their Gram matrix and by the residual along them, so that no factorisation of all columns is needed. One scale
for all members is not tried, as a cause that sets in at every pose alike is none of these.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import comb

import numpy as np
from scipy import special

from calib.array_types import Array, BoolArray, IndexArray
from calib.screening.evidence import GAIN, SCALES, Evidence, evidence_by_scale, most_columns, posterior, scale_penalty
from calib.statistics import f_sf

RARITY = 2.0  # log odds against each: what sets in at one pose or sits at one place is rarer than what is always there
FEWEST_APART = 4  # poses at which two members have to differ
_APART = 0.1  # of a member's largest amount, by which it differs from another at a pose
_MOST_PAIRED = 100  # places of one displacement, evenly taken, of which pairs are tried
_ROUNDING = 1e-14  # share of a square sum
_VISIBLE = 1e-6  # of a member's directions, by length over its longest


@dataclass(frozen=True)
class SparseColumns:
    """Data of the test of a step or dent effect: projected residual (R,), and columns (R, G, K) of G possible places.

    The residual is measured minus predicted.

    Columns are for coefficients of the parameters' usual scales.
    """

    residual: Array
    columns: Array
    dof: int
    positive: bool = False  # whether coefficients are physical with this sign only
    most: int = 8  # members that may carry it
    shapes: Array | None = None  # (G, N) amount at each pose, where members are shapes of a displacement
    of_same: IndexArray | None = None  # (G,) members with the same number are shapes of the same displacement
    superposed: bool = False  # whether several shapes of one displacement make up one cause
    _distinct: dict[int, BoolArray] = field(default_factory=dict, init=False, compare=False, repr=False)

    def distinct(self, member: int) -> BoolArray:
        """Mask (G,) of the members that differ from a given member at `FEWEST_APART` poses or more.

        Two steps at neighbouring poses, one back, are an error of the pose between: an outlier, no cause.
        """
        if member not in self._distinct:
            out = np.arange(self.columns.shape[1]) != member
            if self.shapes is not None and self.of_same is not None:
                same = np.flatnonzero(self.of_same == self.of_same[member])
                largest = float(np.abs(self.shapes[member]).max(initial=0.0))
                off = np.abs(self.shapes[same] - self.shapes[member]) > _APART * largest
                out[same] &= np.count_nonzero(off, axis=1) >= FEWEST_APART
            self._distinct[member] = out
        return self._distinct[member]

    @cached_property
    def gram(self) -> Array:
        """Gram matrix (G, K, K) of each member's columns."""
        return _products(self.columns, self.columns)

    def shares(self, signals: Array) -> Array:
        """Largest share (F,) of each signal (R, F) that a single member (one place of the effect) could explain."""
        count, members, width = self.columns.shape
        along = (signals.T @ self.columns.reshape(count, -1)).reshape(-1, members, width)
        lengths, directions = np.linalg.eigh(self.gram)
        visible = lengths > _VISIBLE**2 * np.maximum(lengths[:, -1:], 1e-300)
        h2 = np.einsum("fgk,gkl->fgl", along, directions) ** 2
        explained = np.sum(np.where(visible, h2 / np.where(visible, lengths, 1.0), 0.0), axis=2)
        return explained.max(axis=1) / np.maximum(np.sum(signals**2, axis=0), 1e-300)


@dataclass(frozen=True)
class _Chosen:
    """Members of the effect (its places) chosen so far, with the prior scale of each."""

    members: tuple[int, ...] = ()
    scales: tuple[float, ...] = ()

    def without(self, member: int) -> _Chosen:
        kept = [(m, s) for m, s in zip(self.members, self.scales, strict=True) if m != member]
        return _Chosen(tuple(m for m, _ in kept), tuple(s for _, s in kept))

    def with_member(self, member: int, scale: float) -> _Chosen:
        return _Chosen((*self.members, member), (*self.scales, scale))


@dataclass(frozen=True)
class _Search:
    """Members chosen so far, their log evidence, and what their choice costs."""

    chosen: _Chosen
    raw: float
    paid: float

    @property
    def worth(self) -> float:
        return self.raw - self.paid


def evaluate_sparse(family: SparseColumns) -> Evidence:
    """F test and evidence of an effect with many members (possible places), of which few are active.

    The likelihood of one member is averaged over all, as it could be any of them; each further one, added while the
    evidence grows, costs log G; and each costs `RARITY`: else a staircase of steps would follow every drift. Where
    shapes of one displacement are superposed, a further one is chosen among these alone, and is not rare. The search
    starts from the best member, and from the best pair that goes and comes back, of which neither shows alone. The F
    test is the best single member's, its p-value times G, or that of all chosen ones, times the ways to choose them.
    """
    residual = family.residual
    count, members, width = family.columns.shape
    nothing = np.zeros((members, width))
    total = float(residual @ residual)
    if total <= 0.0 or not np.any(family.gram):
        return Evidence(1.0, 0.0, np.zeros(members), tuple(nothing), np.zeros(count), 0)
    p_value, rank = _gate(family)
    values, scales = _each(family, _Chosen())
    best = int(np.argmax(values))
    raw = float(values[best])
    start = _Search(_Chosen((best,), (float(scales[best]),)), raw, raw - mean_likelihood(values) + RARITY)
    found = _grown(family, start)
    pair = _there_and_back(family)
    if pair is not None and pair.worth > found.worth + GAIN:
        found = max(found, _grown(family, pair), key=lambda one: one.worth)
    chosen = found.chosen
    columns = np.concatenate([family.columns[:, m] for m in chosen.members], axis=1)
    if len(chosen.members) > 1:
        p_together, rank_together = _gate_together(family, columns, len(chosen.members))
        if p_together < p_value:
            p_value, rank = p_together, rank_together
    spread = np.repeat(chosen.scales, width)
    one_sided = np.full(len(spread), family.positive)
    weights, gain = posterior(columns, residual, spread, one_sided, family.dof)
    coefficients, of_member = nothing.copy(), np.zeros(members)
    coefficients[list(chosen.members)] = weights.reshape(-1, width)
    of_member[list(chosen.members)] = chosen.scales
    evidence = max(found.worth + gain, 0.0)
    return Evidence(p_value, evidence, of_member, tuple(coefficients), columns @ weights, rank)


def _cost(family: SparseColumns) -> float:
    """Log evidence that a further member has to bring, as it could have been any and such causes are rare."""
    return float(np.log(family.columns.shape[1])) + RARITY


def _costs(family: SparseColumns, chosen: _Chosen) -> Array:
    """Log evidence (G,) that each member has to bring beside those that were chosen."""
    out = np.full(family.columns.shape[1], _cost(family))
    if family.superposed and family.of_same is not None:
        beside = np.isin(family.of_same, family.of_same[list(chosen.members)])
        out[beside] = np.log(np.bincount(family.of_same)[family.of_same[beside]])
    return out


def _grown(family: SparseColumns, start: _Search) -> _Search:
    """Members added one by one to those of a start while the evidence grows by more than each costs."""
    width = family.columns.shape[2]
    most = min(family.most, family.columns.shape[1], most_columns(family.dof) // width)
    found = start
    while len(found.chosen.members) < most:
        values, scales = _each(family, found.chosen)
        costs = _costs(family, found.chosen)
        best = int(np.argmax(values - costs))
        if values[best] < found.raw + costs[best] + GAIN:
            break
        more = found.chosen.with_member(best, float(scales[best]))
        found = _Search(*_polished(family, more, float(values[best])), found.paid + float(costs[best]))
    return found


def _there_and_back(family: SparseColumns) -> _Search | None:
    """Best pair of members of one displacement that take each other back, such as a knock and its correction.

    Each pair is compared by what it explains with one size for both; the best of them is then polished. None where the
    family has no shapes, what happened cannot be undone (a sign is given), or there are too few equations for two.
    """
    width = family.columns.shape[2]
    too_few = min(family.most, most_columns(family.dof) // width) < 2
    if family.shapes is None or family.of_same is None or family.positive or too_few:
        return None
    along = np.tensordot(family.residual, family.columns, axes=1)  # (G, K)
    most, pair = 0.0, (0, 0)
    for kind in np.unique(family.of_same):
        same = np.flatnonzero(family.of_same == kind)
        same = same[:: -(-len(same) // _MOST_PAIRED)]
        one, other = np.triu_indices(len(same), 1)
        apart = np.abs(family.shapes[same][:, None] - family.shapes[same]) > 0.5
        kept = np.count_nonzero(apart, axis=2)[one, other] >= FEWEST_APART
        one, other = one[kept], other[kept]
        if not len(one):
            continue
        columns = family.columns[:, same]
        products = np.einsum("rgk,rhl->ghkl", columns, columns, optimize=True)
        both = products[one, other]
        gram = products[one, one] + products[other, other] - both - np.swapaxes(both, 1, 2)
        gram += _VISIBLE * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(width) + 1e-300 * np.eye(width)
        change = along[same][one] - along[same][other]
        explained = np.einsum("pk,pk->p", change, np.linalg.solve(gram, change[..., None])[..., 0])
        best = int(np.argmax(explained))
        if explained[best] > most:
            most, pair = float(explained[best]), (int(same[one[best]]), int(same[other[best]]))
    total = float(family.residual @ family.residual)
    likeliest = -0.5 * family.dof * float(np.log(max(1.0 - most / total, _ROUNDING)))
    if most <= 0.0 or likeliest < 2.0 * _cost(family):  # the best sizes of all could not pay for two members
        return None
    chosen = _Chosen()
    for member in pair:
        values, scales = _each(family, chosen)
        chosen, raw = chosen.with_member(member, float(scales[member])), float(values[member])
    return _Search(*_polished(family, chosen, raw), 2.0 * _cost(family))


def _products(left: Array, right: Array) -> Array:
    """Products (G, K, L) of the columns (R, G, K) and (R, G, L) of each of G members."""
    if left.shape[2] == right.shape[2] == 1:
        return np.einsum("rg,rg->g", left[:, :, 0], right[:, :, 0])[:, None, None]
    return np.einsum("rgk,rgl->gkl", left, right, optimize=True)


def _gate(family: SparseColumns) -> tuple[float, int]:
    """p-value of the best of G members, times G, and the rank of that member's columns."""
    residual = family.residual
    along = np.tensordot(residual, family.columns, axes=1)  # (G, K)
    lengths, directions = np.linalg.eigh(family.gram)
    visible = lengths > _VISIBLE**2 * np.maximum(lengths[:, -1:], 1e-300)
    h2 = np.einsum("gk,gkl->gl", along, directions) ** 2
    explained = np.sum(np.where(visible, h2 / np.where(visible, lengths, 1.0), 0.0), axis=1)
    rank = np.count_nonzero(visible, axis=1)
    rest_dof = family.dof - rank
    tested = (rank > 0) & (rest_dof > 0)
    rest = np.maximum(float(residual @ residual) - explained, 1e-300)
    ratio = np.where(tested, explained / np.maximum(rank, 1) * np.maximum(rest_dof, 1) / rest, 0.0)
    p = np.where(tested, special.fdtrc(np.maximum(rank, 1), np.maximum(rest_dof, 1), ratio), 1.0)
    best = int(np.argmin(p))
    return min(1.0, len(p) * float(p[best])), int(rank[best])


def _gate_together(family: SparseColumns, columns: Array, count: int) -> tuple[float, int]:
    """p-value of several members together, times the number of ways to choose as many, and the rank of their columns.

    Twice that, as there was the test of the best one before: one of two steps, there and back, explains little alone.
    """
    left, lengths, _ = np.linalg.svd(columns, full_matrices=False)
    left = left[:, lengths > _VISIBLE * lengths[0]]
    rank = left.shape[1]
    explained = float(np.sum((left.T @ family.residual) ** 2))
    rest = max(float(family.residual @ family.residual) - explained, 1e-300)
    p = f_sf(explained / rank / (rest / (family.dof - rank)), rank, family.dof - rank)
    return min(1.0, 2.0 * comb(family.columns.shape[1], count) * p), rank


def _each(family: SparseColumns, chosen: _Chosen) -> tuple[Array, Array]:
    """Log evidence (G,) of the chosen members plus each other member, and the added one's best prior scale (G,)."""
    residual, dof = family.residual, family.dof
    total = float(residual @ residual)
    gram, along, left, fixed = family.gram, np.tensordot(residual, family.columns, axes=1), total, 0.0
    if chosen.members:
        width = family.columns.shape[2]
        spread = np.repeat(chosen.scales, width)
        inside = np.concatenate([family.columns[:, m] for m in chosen.members], axis=1) * spread
        root = np.linalg.cholesky(np.eye(len(spread)) + inside.T @ inside)
        basis = np.linalg.solve(root, inside.T)  # (C, R): 1 / (1 + A S^2 A^T) = 1 - basis^T basis
        seen, taken = basis @ residual, np.tensordot(basis, family.columns, axes=1)  # (C,), (C, G, K)
        gram = gram - _products(taken, taken)
        along = along - np.tensordot(seen, taken, axes=1)
        left = total - float(seen @ seen)
        fixed = -float(np.sum(np.log(np.diag(root)))) + float(np.sum(scale_penalty(np.array(chosen.scales))))
    lengths, directions = np.linalg.eigh(gram)
    lengths = np.maximum(lengths, 0.0)
    h2 = np.einsum("gk,gkl->gl", along, directions) ** 2
    h2 = np.where(lengths > 0.0, h2 / np.where(lengths > 0.0, lengths, 1.0), 0.0)
    # Below rounding a direction is hidden, and its share would be noise over noise.
    h2 = np.where(lengths > _VISIBLE**2 * np.maximum(lengths[:, -1:], 1e-300), h2, 0.0)
    values = fixed + evidence_by_scale(lengths[:, None], h2[:, None], left, total, dof)
    best = np.argmax(values, axis=1)
    out = np.take_along_axis(values, best[:, None], axis=1)[:, 0]
    for member in chosen.members:
        out[~family.distinct(member)] = -np.inf
    return out, SCALES[best]


def _polished(family: SparseColumns, chosen: _Chosen, raw: float) -> tuple[_Chosen, float]:
    """Chosen members after each was replaced by the best one given the others, and their log evidence.

    An earlier one was chosen without those that came later.
    """
    for member in chosen.members:
        others = chosen.without(member)
        values, scales = _each(family, others)
        best = int(np.argmax(values))
        if values[best] >= raw:
            chosen, raw = others.with_member(best, float(scales[best])), float(values[best])
    return chosen, raw


def mean_likelihood(log_evidence: Array) -> float:
    """Log evidence that one of several hypotheses (G,), equally likely a priori, holds: log mean exp."""
    top = float(np.max(log_evidence))
    return top + float(np.log(np.mean(np.exp(log_evidence - top))))
