"""The bows of a jig's faces, learned once from all scans of it together, and the corners that follow from them.

A face that is bowed by 0.05 mm moves a corner by as much: a plane fits the part of the face that a scan shows, and the
covariance has to allow for any bow. One scan hardly tells a bow from the scanner's smooth error. All scans of a set
show one jig: what repeats in its faces from scan to scan is theirs. Scan k tells of the bows

    c_k = c + e_k,     c normal with standard deviation t, the jig's;  e_k normal with s, of that scan alone,

by its likelihood (`correlated_noise.bow`), either of degree 2, or of degree 4 with parts of a third of t. Either the
three faces are bowed alike, apart from differences that e_k takes, or each in its own way. Three faces look alike, so
in that case c and the face with which each scan begins are found together, by expectation maximisation, and what the
order of the faces leaves open is taken off the information on c (Louis 1982). Against that stands c = 0 with any s.
Where bows are believed, each corner is that in which the bowed faces meet: planes are those given c, as far as that
scan agrees, moved to the faces' heights at the apex, averaged over the hypotheses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from calib.array_types import Array
from calib.brief import Brief
from calib.corners.correlated_noise.bow import QUADRATIC, TERMS, BowEvidence, heights
from calib.corners.intersection import Corner, moved_corner

_SIZES_MM = (0.01, 0.03, 0.1, 0.3)  # t
_SCATTERS_MM = (0.0005, 0.002, 0.006, 0.02, 0.06)  # s
_HIGHER = (0.0, 1 / 3)  # t of the parts of degree 3 and 4, in units of that of degree 2
_PRIOR, _BELIEVED = 0.05, 0.99
_FEWEST = 4  # scans
_SHOWN = 0.25  # share of the scans that show bows by themselves, from which the jig's are sought; 0.09 of white noise
_LEAST_WEIGHT = 1e-3
_SHARED = 0.05  # of a scan's variance, that all scans have in common
_ROUNDS, _STARTS = 10, 3
_OUTLYING = 16.0  # times the median squared deviation of a scan from the common bows
_COUNT = 3 * TERMS
_ROLLED = np.array([np.roll(np.arange(_COUNT), TERMS * turn) for turn in range(3)])


@dataclass(frozen=True)
class FaceBows(Brief):
    """Bows of the faces of one jig, as all scans of it tell them."""

    probability: float  # that the faces are bowed
    sag_mm: tuple[float, float, float]  # of each face's middle over the plane through its three corners, outwards
    sigma_mm: tuple[float, float, float]
    scans: int  # that were counted
    outlying: tuple[str, ...]  # scans whose faces look different from all others', left as they are

    def _brief(self) -> str:
        return f"{', '.join(f'{sag:+.4f}' for sag in self.sag_mm)} mm, by {self.scans} scans"


@dataclass(frozen=True)
class _Common:
    """Bows that scans have in common under one hypothesis."""

    log_evidence: float
    bows: Array  # (36,) mm, in the common order
    covariance: Array  # (36, 36)
    scatter: Array  # (36,) variances of one scan's own
    alike: bool  # of the three faces
    share: Array  # (K, 3) probability of each turn of the scan's faces


def with_common_bows(corners: Mapping[str, Corner]) -> tuple[dict[str, Corner], FaceBows | None]:
    """Corners of one jig whose faces are bowed as all scans tell; as they are, and None, where no bow is believed.

    It makes no difference whether bows or angles are already held in the corners.
    """
    result = {name: (corner.free or corner) for name, corner in corners.items()}
    result = {name: corner.flat or corner for name, corner in result.items()}
    known = {name: corner.bows for name, corner in result.items() if corner.bows is not None}
    if len(known) < max(_FEWEST, len(result) / 2):
        return result, None
    if sum(bows.shown for bows in known.values()) < _SHOWN * len(known):
        return result, None
    probability, weights, hypotheses = _learned(list(known.values()))
    common = hypotheses[int(np.argmax(weights))]
    squares = [_square(common, k, bows) for k, bows in enumerate(known.values())]
    outlying = tuple(name for name, square in zip(known, squares, strict=True) if square > _OUTLYING * _middle(squares))
    if outlying:
        known = {name: bows for name, bows in known.items() if name not in outlying}
        if len(known) < _FEWEST:
            return result, None
        probability, weights, hypotheses = _learned(list(known.values()))
        common = hypotheses[int(np.argmax(weights))]
    if probability < _BELIEVED:
        return result, None
    for k, (name, bows) in enumerate(known.items()):
        told = [(w, *_moves(bows, one, k)) for w, one in zip(weights, hypotheses, strict=True) if w > _LEAST_WEIGHT]
        total = sum(w for w, _, _ in told)
        moves = sum(w / total * mean for w, mean, _ in told)
        spread = sum(w / total * (c + np.outer(mean - moves, mean - moves)) for w, mean, c in told)
        result[name] = replace(moved_corner(result[name], moves, spread), flat=result[name])
    sag_mm, sigma_mm = _sags(common, next(iter(known.values())).rectangular)
    return result, FaceBows(probability, sag_mm, sigma_mm, len(known), outlying)


def _moves(bows: BowEvidence, common: _Common, scan: int) -> tuple[Array, Array]:
    """Moves (9,) of a scan's planes, by which they meet where the bowed faces do, and their covariance (9, 9)."""
    turn = _ROLLED[int(np.argmax(common.share[scan]))]
    mean, covariance = common.bows[turn], common.covariance[np.ix_(turn, turn)]
    own = _own_gain(bows.information, common.scatter)  # of what this scan alone shows
    by_jig = bows.at_apex - bows.by_bows
    by_own = by_jig if common.alike else -bows.by_bows  # differences of faces bowed alike are the jig's
    through = by_jig - by_own @ own @ bows.information
    moves = bows.moves + through @ mean + by_own @ own @ bows.gradient
    of_planes = bows.covariance + by_own @ own @ by_own.T + through @ covariance @ through.T
    return moves, 0.5 * (of_planes + of_planes.T)


def _own_gain(information: Array, scatter: Array) -> Array:
    """Covariance (36, 36) of a scan's own bows, given the common ones, from its information and their variances."""
    return np.asarray(scatter[:, None] * np.linalg.inv(np.eye(_COUNT) + information * scatter))


def _learned(scans: Sequence[BowEvidence]) -> tuple[float, Array, list[_Common]]:
    """Probability that the faces are bowed, and probabilities (H,) of the hypotheses where they are, with the bows."""
    flat, bowed = [], []
    for scatter_mm, higher in product(_SCATTERS_MM, _HIGHER):
        parts = _parts(higher)
        likelihood = _Likelihood.of(scans, scatter_mm**2 * parts)
        flat.append(float(likelihood.constant.sum()))
        bowed += [
            _common(likelihood, size_mm**2 * parts, scatter_mm**2 * parts, alike=alike)
            for size_mm in _SIZES_MM
            for alike in (True, False)
        ]
    evidence = np.array([one.log_evidence for one in bowed])
    for_bows = np.logaddexp.reduce(evidence) - np.log(len(bowed)) + np.log(_PRIOR)
    for_none = np.logaddexp.reduce(flat) - np.log(len(flat)) + np.log(1 - _PRIOR)
    weights = np.exp(evidence - np.logaddexp.reduce(evidence))
    return float(np.exp(for_bows - np.logaddexp(for_bows, for_none))), weights, bowed


def _parts(higher: float) -> Array:
    """(36,) variances of the parts of bows in units of those of degree 2."""
    return np.tile(np.where(np.arange(TERMS) < QUADRATIC, 1.0, higher**2), 3)


@dataclass(frozen=True)
class _Likelihood:
    """Log likelihood h' c - c' S c / 2 + constant of common bows c by K scans, each turned in three ways."""

    gradient: Array  # (K, 3, 36)
    information: Array  # (K, 3, 36, 36)
    constant: Array  # (K,)

    @staticmethod
    def of(scans: Sequence[BowEvidence], scatter: Array) -> _Likelihood:
        """Likelihood where each scan has bows of its own besides, of variances `scatter` (36,)."""
        gradients, informations, constants = [], [], []
        for scan in scans:
            spread = np.eye(_COUNT) + scan.information * scatter
            both = np.linalg.solve(spread, np.column_stack([scan.gradient, scan.information]))
            gradient, information = both[:, 0], 0.5 * (both[:, 1:] + both[:, 1:].T)
            own = 0.5 * float(scan.gradient @ (scatter * gradient)) - 0.5 * float(np.linalg.slogdet(spread)[1])
            back = np.argsort(_ROLLED, axis=1)  # from a scan's own order to the common one
            gradients.append(gradient[back])
            informations.append(information[back[:, :, None], back[:, None, :]])
            constants.append(own)
        return _Likelihood(np.array(gradients), np.array(informations), np.array(constants))


def _common(likelihood: _Likelihood, prior: Array, scatter: Array, *, alike: bool) -> _Common:
    """Common bows of prior variances (36,), `alike` on all faces or not, by expectation maximisation."""
    used = np.flatnonzero(prior > 0)
    free = np.eye(_COUNT)[:, used]  # from what is free to the bows
    if alike:
        free = np.tile(np.eye(TERMS)[:, used[used < TERMS]], (3, 1))
    weight = np.diag(1.0 / prior[used[: free.shape[1]]])
    count = len(likelihood.constant)
    gradient, information = likelihood.gradient @ free, free.T @ likelihood.information @ free
    starts = [np.full((count, 3), 1 / 3)]
    if not alike:
        known = np.argsort(-np.trace(likelihood.information[:, 0], axis1=1, axis2=2))[: _STARTS - 1]
        starts += [_as_first(count, int(k)) for k in known]
    best: _Common | None = None
    for share in starts:
        for _ in range(_ROUNDS):
            total = np.einsum("kt,ktij->ij", share, information) + weight
            bows = np.linalg.solve(total, np.einsum("kt,kti->i", share, gradient))
            fits = gradient @ bows - 0.5 * np.einsum("i,ktij,j->kt", bows, information, bows)
            each = np.logaddexp.reduce(fits, axis=1)
            before, share = share, np.exp(fits - each[:, None])
            if np.abs(share - before).max() < 1e-3:
                break
        score = gradient - information @ bows
        mean = np.einsum("kt,kti->ki", share, score)
        total = total - np.einsum("kt,kti,ktj->ij", share, score, score) + mean.T @ mean
        own, turns = np.linalg.eigh(total)
        own = np.maximum(own, weight[0, 0])
        evidence = float(each.sum() - count * np.log(3) + likelihood.constant.sum())
        evidence -= 0.5 * float(bows @ weight @ bows - np.linalg.slogdet(weight)[1] + np.log(own).sum())
        if best is None or evidence > best.log_evidence:
            covariance = (1 + _SHARED * count) * (free @ turns / own) @ (free @ turns).T
            best = _Common(evidence, free @ bows, covariance, scatter, alike, share)
    assert best is not None
    return best


def _as_first(count: int, scan: int) -> Array:
    """(K, 3) probabilities of the turns where one scan alone is known, in its own order."""
    share = np.zeros((count, 3))
    share[scan, 0] = 1.0
    return share


def _square(common: _Common, scan: int, bows: BowEvidence) -> float:
    """Squared deviation of a scan's bows from the common ones, where it can tell them."""
    turn = _ROLLED[int(np.argmax(common.share[scan]))]
    off = bows.gradient - bows.information @ common.bows[turn]
    expected = bows.information + bows.information @ (common.scatter[:, None] * bows.information)
    return float(off @ np.linalg.pinv(expected, rcond=1e-9, hermitian=True) @ off)


def _middle(squares: Sequence[float]) -> float:
    return float(np.median(squares))


def _sags(common: _Common, rectangular: bool) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Height of each face's middle over the plane through its apex and the ends of its edges, mm, and sigmas."""
    middle = 0.5 if rectangular else 1 / 3
    at = heights(np.array([[middle, middle], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), rectangular)
    by_bow = at[0] - (1 - 2 * middle) * at[1] - middle * (at[2] + at[3])
    rows = np.kron(np.eye(3), by_bow)
    one, two, three = (rows @ common.bows).tolist()
    first, second, third = np.sqrt(np.diag(rows @ common.covariance @ rows.T)).tolist()
    return (one, two, three), (first, second, third)
