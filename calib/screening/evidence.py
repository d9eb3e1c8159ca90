"""F test and Bayesian evidence of effects that may explain a residual, the size of their coefficients unknown.

All of it is linear and works on residual and columns from which the fitted directions were projected out. The sigma of
the noise is never needed: it is estimated with each hypothesis, so that a wrongly declared one changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calib.array_types import Array, BoolArray
from calib.statistics import f_sf, normal_cdf

SCALES = np.geomspace(1e-3, 1e4, 57)  # that are tried, of a member's coefficients over their usual scale
GAIN = 0.5  # a further member has to raise the log evidence by this, beyond what choosing it costs
_FIRSTS = 4  # members that are tried as the first of two that replace one
_TIE = 1e-9  # log evidence, below which two choices are the same
_SIGN_PRIOR = 0.9  # probability that a coefficient has the sign that physics asks for
_ROUNDING = 1e-14  # share of a square sum


@dataclass(frozen=True)
class FamilyColumns:
    """Data of one effect's test: the projected residual (R,), and the Jacobian columns (R, K_g) of each member g.

    The residual is measured minus predicted.

    Columns are for coefficients of the parameters' usual scales. `positive`: for each group, whether its coefficients
    are physical with this sign only; empty: none is.
    """

    residual: Array
    groups: tuple[Array, ...]
    dof: int
    positive: tuple[bool, ...] = ()
    few: bool = False


@dataclass(frozen=True)
class Evidence:
    """Evidence for an effect: p-value, log evidence over noise alone, prior scales and estimated coefficients."""

    p_value: float  # F test of the whole family or of its best member, the smaller, corrected for the choice
    log_evidence: float
    scales: Array  # (G,) of each member's coefficients; zero where it is not needed
    coefficients: tuple[Array, ...]  # posterior means, one array a member
    explained: Array  # (R,) the part of the residual that they explain
    rank: int


def evaluate_family(family: FamilyColumns) -> Evidence:
    """F test and evidence of an effect that has few members, such as one per joint.

    Evidence: coefficients of member g are N(0, s_g^2), noise N(0, sigma^2) with sigma unknown,

        log E(s) = -1/2 log det(1 + B S^2 B^T) - nu/2 log(r^T (1 + B S^2 B^T)^-1 r / r^T r),

    maximised over one s for all members, and over separate ones where few members carry the effect; each member that is
    chosen then costs log(number of members), as it could have been any. Sizes far above the usual one count against it:
    a link that would have to be a thousand times softer than links are is no explanation. So do coefficients of an
    unphysical sign, see `_coefficients`.
    """
    y, rest, triangle, bounds = _reduce(family.residual, family.groups)
    total = rest + float(y @ y)
    if triangle.shape[1] == 0 or total <= 0.0:
        nothing = tuple(np.zeros(g.shape[1]) for g in family.groups)
        return Evidence(1.0, 0.0, np.zeros(len(bounds)), nothing, np.zeros_like(family.residual), 0)
    p_value, rank = _gate(y, rest, triangle, bounds, family.dof)
    tried = []
    if triangle.shape[1] <= most_columns(family.dof) and not family.few:
        together = np.ones(len(bounds), dtype=bool)
        shared_value, shared_scale = _best_scale(
            y, rest, triangle, np.zeros(triangle.shape[1]), together, bounds, family.dof
        )
        tried.append((shared_value, np.full(len(bounds), shared_scale)))
    if len(bounds) > 1 or not tried:
        sparse_scales, sparse_value = _choose_members(y, rest, triangle, bounds, family.dof)
        tried.append((sparse_value, sparse_scales))
    widths = [b - a for a, b in bounds]
    one_sided = np.repeat(family.positive or [False] * len(bounds), widths)
    found = []
    for found_value, found_scales in tried:
        spread = np.repeat(found_scales, widths)
        weights, gain = _coefficients(y, rest, triangle, spread, one_sided, family.dof)
        found.append((found_value + gain, found_scales, weights))
    value, scales, weights = max(found, key=lambda one: one[0])
    explained = np.concatenate(family.groups, axis=1) @ weights
    coefficients = tuple(weights[a:b] for a, b in bounds)
    return Evidence(p_value, max(value, 0.0), scales, coefficients, explained, rank)


def most_columns(dof: int) -> int:
    """Largest number of parameters that an effect may have with these degrees of freedom and still be testable."""
    return dof // 2


def evidence_of(residual: Array, columns: Array, dof: int) -> float:
    """Log evidence, over noise alone, that a linear model with columns (R, K) explains a residual."""
    total = float(residual @ residual)
    if columns.shape[1] == 0 or total <= 0.0:
        return 0.0
    values = evidence_by_scale(*_spectrum(columns, residual), total, total, dof)
    return max(float(np.max(values)), 0.0)


def _coefficients(
    y: Array, rest: float, triangle: Array, spread: Array, one_sided: BoolArray, dof: int
) -> tuple[Array, float]:
    """Posterior means (K,) of the coefficients, and the change of the log evidence by the signs they should have.

    With a one-sided prior the evidence is multiplied by P(all >= 0 | data) / P(all >= 0) = 2^k P(all >= 0 | data) for k
    one-sided coefficients. The sign is believed with probability `_SIGN_PRIOR`, so that an opposite sign convention, or
    a cause of opposite sign, costs log evidence and is not excluded.
    """
    active = spread > 0.0
    columns = triangle[:, active]
    precision = columns.T @ columns + np.diag(spread[active] ** -2.0)
    covariance = np.linalg.inv(precision)
    mean = covariance @ (columns.T @ y)
    weights = np.zeros(len(spread))
    weights[active] = mean
    bounded = one_sided[active] & np.any(columns, axis=0)
    if not bounded.any():
        return weights, 0.0
    variance = max(rest + float(y @ (y - columns @ mean)), 1e-300) / dof
    covariance = variance * covariance[np.ix_(bounded, bounded)]
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    share = normal_cdf(mean[bounded] / scale, correlation)
    return weights, float(np.log(_SIGN_PRIOR * 2.0 ** len(scale) * share + 1.0 - _SIGN_PRIOR))


def _reduce(residual: Array, groups: tuple[Array, ...]) -> tuple[Array, float, Array, list[tuple[int, int]]]:
    """QR reduction of the linear model: Q^T r, |r|^2 outside the columns' span, R, and each member's columns in R."""
    ends = np.cumsum([0, *(g.shape[1] for g in groups)])
    bounds = [(int(a), int(b)) for a, b in pairwise(ends)]
    q, triangle = np.linalg.qr(np.concatenate(groups, axis=1))
    y = q.T @ residual
    return y, max(float(residual @ residual) - float(y @ y), 0.0), triangle, bounds


def _f_test(y: Array, rest: float, columns: Array, dof: int) -> tuple[float, int]:
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-6 * max(float(s[0]), 1e-300)] if len(s) and s[0] > 1e-9 else u[:, :0]
    rank = u.shape[1]
    rest_dof = dof - rank
    if rank == 0 or rest_dof <= 0:
        return 1.0, rank
    explained = float(np.sum((u.T @ y) ** 2))
    unexplained = max(rest + float(y @ y) - explained, 1e-300)
    return f_sf(explained / rank / (unexplained / rest_dof), rank, rest_dof), rank


def _gate(y: Array, rest: float, triangle: Array, bounds: list[tuple[int, int]], dof: int) -> tuple[float, int]:
    """p-value of an effect by F tests of all its members and of its best one, and the rank of its columns.

    Twice the smaller of the whole family's p-value and its best member's, the latter times the number of members.
    """
    whole, rank = _f_test(y, rest, triangle, dof)
    if len(bounds) == 1:
        return whole, rank
    single = min(_f_test(y, rest, triangle[:, a:b], dof)[0] for a, b in bounds)
    return min(1.0, 2.0 * min(whole, len(bounds) * single)), rank


def _best_scale(
    y: Array, rest: float, triangle: Array, spread: Array, chosen: BoolArray, bounds: list[tuple[int, int]], dof: int
) -> tuple[float, float]:
    """Highest log evidence over one common prior scale of the chosen members, and that scale; others are fixed."""
    of = np.repeat(chosen, [b - a for a, b in bounds])
    z, columns, fixed = _given(y, triangle[:, of], triangle, np.where(of, 0.0, spread))
    lam, h2 = _spectrum(columns, z)
    values = fixed + evidence_by_scale(lam, h2, rest + float(z @ z), rest + float(y @ y), dof)
    best = int(np.argmax(values))
    return float(values[best]), float(SCALES[best])


def _given(y: Array, columns: Array, triangle: Array, spread: Array) -> tuple[Array, Array, float]:
    """Residual and columns whitened by noise and by the members chosen already, with these members' log determinant."""
    others = spread > 0.0
    if not others.any():
        return y, columns, 0.0
    root = np.linalg.cholesky(np.eye(len(y)) + (triangle[:, others] * spread[others] ** 2) @ triangle[:, others].T)
    whitened = np.linalg.solve(root, np.column_stack([y, columns]))
    return whitened[:, 0], whitened[:, 1:], -float(np.sum(np.log(np.diag(root))))


def _best_scales(y: Array, rest: float, triangle: Array, spread: Array, width: int, dof: int) -> tuple[Array, Array]:
    """Log evidence (G,) of each member at its best prior scale, given the chosen members; and these scales (G,).

    Each member is `width` columns wide.
    """
    z, columns, fixed = _given(y, triangle, triangle, spread)
    members = columns.T.reshape(-1, width, len(y))
    u, s, _ = np.linalg.svd(np.swapaxes(members, 1, 2), full_matrices=False)
    h2 = np.einsum("grk,r->gk", u, z)[:, None, :] ** 2
    values = fixed + evidence_by_scale(s[:, None, :] ** 2, h2, rest + float(z @ z), rest + float(y @ y), dof)
    best = np.argmax(values, axis=1)
    return np.take_along_axis(values, best[:, None], axis=1)[:, 0], SCALES[best]


def evidence_by_scale(lam: Array, h2: Array, rest: float, total: float, dof: int) -> Array:
    """Log evidence over noise alone at each prior scale of `SCALES`, from singular values and projections.

    lam: squared singular values. h2: squared projections. rest: squared residual given the other members. total:
    without them.
    """
    grow = 1.0 + SCALES[:, None] ** 2 * lam  # (..., scales, K)
    quadratic = rest - np.sum(h2 * (1.0 - 1.0 / grow), axis=-1)
    least = _ROUNDING * max(total, 1e-300)  # exact data: the rest is rounding, and has no logarithm
    fit = -0.5 * dof * np.log(np.maximum(quadratic, least) / max(total, 1e-300))
    return fit - 0.5 * np.sum(np.log(grow), axis=-1) + scale_penalty(SCALES)


def _spectrum(columns: Array, z: Array) -> tuple[Array, Array]:
    """Squared singular values of columns (R, K), and squared projections of a vector on the left singular vectors."""
    if columns.shape[1] == 1:  # most members have one parameter, and this is asked for hundreds of times
        square = float(columns[:, 0] @ columns[:, 0])
        return np.array([square]), np.array([float(columns[:, 0] @ z) ** 2 / max(square, 1e-300)])
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return s**2, (u.T @ z) ** 2


def scale_penalty(scales: Array) -> Array:
    """Log prior of prior scales above the usual size: a factor of ten is one standard deviation."""
    return -0.5 * np.maximum(np.log10(scales), 0.0) ** 2


def _choose_members(
    y: Array, rest: float, triangle: Array, bounds: list[tuple[int, int]], dof: int
) -> tuple[Array, float]:
    """Prior scales (G,) of the members that carry an effect, found one by one; evidence less the cost of choosing.

    Members are added while the evidence grows. After each addition every member may be exchanged for another, and
    where none is worth adding any more, one may be exchanged for two: a member that resembles the sum of two is chosen
    before either, and neither shows beside it.
    """
    choice = _MemberChoice(y, rest, triangle, bounds, dof)
    while choice.add() or choice.exchange_for_two():
        choice.exchange()
    return choice.scales, choice.value - choice.cost * int(np.count_nonzero(choice.scales))


class _MemberChoice:
    """Members of an effect chosen so far, by their prior scales, which the search for more of them changes."""

    def __init__(self, y: Array, rest: float, triangle: Array, bounds: list[tuple[int, int]], dof: int) -> None:
        self.y, self.rest, self.triangle, self.bounds, self.dof = y, rest, triangle, bounds, dof
        self.widths = np.array([b - a for a, b in bounds])
        self.cost = float(np.log(len(bounds)))  # of choosing a member, as it could have been any
        self.scales = np.zeros(len(bounds))
        self.value = 0.0  # log evidence of the members with scales above zero

    def add(self) -> bool:
        """Add the member that raises the evidence the most, if that is worth its choice; tell whether it was."""
        tried = self._each()
        if not tried or max(tried)[0] < self.value + self.cost + GAIN:
            return False
        self.value, scale, newest = max(tried)
        self.scales[newest] = scale
        self._scale_again()
        return True

    def exchange(self) -> None:
        """Exchange each of several members for a better one, where there is one beside the others."""
        chosen = self._chosen()
        for member in chosen if len(chosen) > 1 else ():
            kept, self.scales[member] = self.scales[member], 0.0
            value, scale, other = max(self._each())
            if value > self.value + _TIE and other != member:
                self.value, self.scales[other] = value, scale
            else:
                self.scales[member] = kept

    def exchange_for_two(self) -> bool:
        """Exchange one member for two others where that is worth a further choice; tell whether it was."""
        for member in self._chosen():
            kept, self.scales[member] = self.scales[member], 0.0
            for _, scale, first in sorted(self._each(), reverse=True)[:_FIRSTS]:
                if first == member:
                    continue
                self.scales[first] = scale
                tried = [one for one in self._each() if one[2] != member]
                if tried and max(tried)[0] > self.value + self.cost + GAIN:
                    self.value, scale, second = max(tried)
                    self.scales[second] = scale
                    self._scale_again()
                    return True
                self.scales[first] = 0.0
            self.scales[member] = kept
        return False

    def _chosen(self) -> list[int]:
        return [int(member) for member in np.flatnonzero(self.scales)]

    def _scale_again(self) -> None:
        """Scale each chosen member once more, since the earlier ones were scaled without the later ones."""
        for member in self._chosen():
            self.value, self.scales[member] = self._best(member)

    def _best(self, member: int) -> tuple[float, float]:
        """Log evidence with one member at its best prior scale, given the other members' scales, and that scale."""
        alone = np.arange(len(self.bounds)) == member
        spread = np.repeat(self.scales, self.widths)
        value, scale = _best_scale(self.y, self.rest, self.triangle, spread, alone, self.bounds, self.dof)
        return value + self._penalty(~alone), scale

    def _each(self) -> list[tuple[float, float, int]]:
        """Log evidence, best prior scale and number of every free member that the number of equations allows to add."""
        chosen = self.scales > 0.0
        room = most_columns(self.dof) - int(self.widths[chosen].sum())
        free = np.flatnonzero(~chosen & (self.widths <= room)).tolist()
        if len(set(self.widths)) > 1 or not free:
            return [(*self._best(g), g) for g in free]
        width = int(self.widths[0])
        spread = np.repeat(self.scales, width)
        values, scales = _best_scales(self.y, self.rest, self.triangle, spread, width, self.dof)
        values = values + self._penalty(chosen)
        return [(float(values[g]), float(scales[g]), g) for g in free]

    def _penalty(self, members: BoolArray) -> float:
        """Log prior of the prior scales of those of some members that are chosen."""
        return float(np.sum(scale_penalty(self.scales[members & (self.scales > 0.0)])))


def posterior(columns: Array, residual: Array, spread: Array, one_sided: BoolArray, dof: int) -> tuple[Array, float]:
    """Posterior means (K,) of a linear model's coefficients, and the change of the log evidence by their signs.

    spread  # (K,) scale of each, above 0
    """
    y, rest, triangle, _ = _reduce(residual, (columns,))
    return _coefficients(y, rest, triangle, spread, one_sided, dof)


def holm(p_values: list[float]) -> list[float]:
    """p-values after Holm's step-down correction, in the order given."""
    order = np.argsort(p_values)
    out = np.empty(len(p_values))
    running = 0.0
    for rank, i in enumerate(order):
        running = max(running, min(1.0, (len(p_values) - rank) * p_values[i]))
        out[i] = running
    return out.tolist()
