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

from calib.array_types import Array, Vector
from calib.brief import Brief
from calib.corners.correlated_noise.bow import QUADRATIC, TERMS, BowEvidence, heights
from calib.corners.intersection import Corner, moved_corner
from calib.corners.quality import angle_figures
from calib.jig import Jig

_SIZES_MM = (0.01, 0.03, 0.1, 0.3)  # t
_SCATTERS_MM = (0.0005, 0.002, 0.006, 0.02, 0.06)  # s
_HIGHER = (0.0, 1 / 3)  # t of the parts of degree 3 and 4, in units of that of degree 2
_PRIOR, _BELIEVED = 0.05, 0.99
_FEWEST, _MOST = 4, 60  # scans; of more, every n-th tells the bows
_SHOWN = 0.25  # share of the scans that show bows by themselves, from which the jig's are sought; 0.09 of white noise
_LEAST_WEIGHT = 1e-3
_SHARED = 0.05  # of a scan's variance, that all scans have in common
_ROUNDS, _STARTS = 10, 3
_OUTLYING = 3.0  # times the median squared deviation from the common bows, of 36 numbers: 2.5 once in 100 000
_COUNT = 3 * TERMS
_ROLLED = np.array([np.roll(np.arange(_COUNT), TERMS * turn) for turn in range(3)])


@dataclass(frozen=True)
class FaceBows(Brief):
    """Bows of the faces of one jig, as all scans of it tell them."""

    probability: float  # that the faces are bowed
    sag_mm: Vector  # of each face's middle over the plane through its three corners, outwards
    sigma_mm: Vector
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


def with_common_bows(corners: Mapping[str, Corner], jig: Jig) -> tuple[dict[str, Corner], FaceBows | None]:
    """Corners of one jig whose faces are bowed as all scans tell; as they are, and None, where no bow is believed.

    It makes no difference whether bows or angles are already held in the corners.
    """
    result = {name: corner.as_fitted for name, corner in corners.items()}
    known = {name: corner.bows for name, corner in result.items() if corner.bows is not None}
    if sum(bows.shown for bows in known.values()) < _SHOWN * len(result):
        return result, None
    outlying: tuple[str, ...] = ()
    for _ in range(2):  # once more without the scans that look different
        if len(known) < _FEWEST:
            return result, None
        learned = _Learned.of(list(known.values())[:: -(-len(known) // _MOST)])
        if outlying or learned.probability < _BELIEVED:
            break
        squares = {name: _square(bows, learned.likeliest) for name, bows in known.items()}
        most = _OUTLYING * float(np.median(list(squares.values())))
        outlying = tuple(name for name, square in squares.items() if square > most)
        if not outlying:
            break
        known = {name: bows for name, bows in known.items() if name not in outlying}
    if learned.probability < _BELIEVED:
        return result, None
    for name, bows in known.items():
        flat = result[name]
        bowed = moved_corner(flat, *learned.moves(bows))
        sharper = bowed.sigma_mm() / flat.sigma_mm()
        angles = angle_figures(bowed.faces, bowed.plane_covariance, jig.face_angles_deg)
        quality = replace(bowed.quality, smooth_factor=sharper * flat.quality.smooth_factor, **angles)
        result[name] = replace(bowed, quality=quality, flat=flat)
    sag_mm, sigma_mm = _sags(learned.likeliest, next(iter(known.values())).rectangular)
    return result, FaceBows(learned.probability, sag_mm, sigma_mm, len(known), outlying)


def _turned(bows: BowEvidence, common: _Common) -> tuple[Array, Array]:
    """Common bows (36,) and their covariance in the order of a scan's faces."""
    each = common.bows[_ROLLED]
    fits = each @ bows.gradient - 0.5 * np.einsum("ti,ij,tj->t", each, bows.information, each)
    turn = _ROLLED[int(np.argmax(fits))]
    return common.bows[turn], common.covariance[np.ix_(turn, turn)]


def _moves(bows: BowEvidence, common: _Common) -> tuple[Array, Array]:
    """Moves (9,) of a scan's planes, by which they meet where the bowed faces do, and their covariance (9, 9)."""
    mean, covariance = _turned(bows, common)
    # Of what this scan alone shows, given the common bows.
    own = common.scatter[:, None] * np.linalg.inv(np.eye(_COUNT) + bows.information * common.scatter)
    by_jig = bows.at_apex - bows.by_bows
    by_own = by_jig if common.alike else -bows.by_bows  # differences of faces bowed alike are the jig's
    through = by_jig - by_own @ own @ bows.information
    moves = bows.moves + through @ mean + by_own @ own @ bows.gradient
    return moves, bows.covariance + by_own @ own @ by_own.T + through @ covariance @ through.T


@dataclass(frozen=True)
class _Learned:
    """Hypotheses on the bows of one jig's faces, with their probabilities."""

    probability: float  # that the faces are bowed
    weights: Array  # (H,) probabilities where they are
    hypotheses: tuple[_Common, ...]

    @property
    def likeliest(self) -> _Common:
        return self.hypotheses[int(np.argmax(self.weights))]

    def moves(self, bows: BowEvidence) -> tuple[Array, Array]:
        """Moves (9,) of a scan's planes and their covariance (9, 9), averaged over the hypotheses."""
        told = [(weight, *_moves(bows, one)) for weight, one in zip(self.weights, self.hypotheses, strict=True)
                if weight > _LEAST_WEIGHT]  # fmt: skip
        total = sum(weight for weight, _, _ in told)
        moves = np.asarray(sum(weight * each for weight, each, _ in told)) / total
        spread = sum(weight * (own + np.outer(each - moves, each - moves)) for weight, each, own in told)
        covariance = np.asarray(spread) / total
        return moves, 0.5 * (covariance + covariance.T)

    @staticmethod
    def of(scans: Sequence[BowEvidence]) -> _Learned:
        """Probabilities by the evidence of all scans together."""
        flat, bowed = [], []
        for scatter_mm, higher in product(_SCATTERS_MM, _HIGHER):
            parts = _parts(higher)
            likelihood = _Likelihood.of(scans, scatter_mm**2 * parts)
            flat.append(float(likelihood.constant.sum()))
            bowed += [
                _common(likelihood, size_mm**2 * parts, scatter_mm**2 * parts, alike=alike)
                for size_mm, alike in product(_SIZES_MM, (True, False))
            ]
        evidence = np.array([one.log_evidence for one in bowed])
        for_bows = np.logaddexp.reduce(evidence) - np.log(len(bowed)) + np.log(_PRIOR)
        for_none = np.logaddexp.reduce(flat) - np.log(len(flat)) + np.log(1 - _PRIOR)
        weights = np.exp(evidence - np.logaddexp.reduce(evidence))
        return _Learned(float(np.exp(for_bows - np.logaddexp(for_bows, for_none))), weights, tuple(bowed))


def _parts(higher: float) -> Array:
    """Variances (36,) of the parts of bows in units of those of degree 2."""
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
            best = _Common(evidence, free @ bows, covariance, scatter, alike)
    assert best is not None
    return best


def _as_first(count: int, scan: int) -> Array:
    """Probabilities (K, 3) of the turns where one scan alone is known, in its own order."""
    share = np.zeros((count, 3))
    share[scan, 0] = 1.0
    return share


def _square(bows: BowEvidence, common: _Common) -> float:
    """Squared deviation of a scan's bows from the common ones, as far as it tells them."""
    off = bows.gradient - bows.information @ _turned(bows, common)[0]
    expected = bows.information + bows.information @ (common.scatter[:, None] * bows.information)
    return float(off @ np.linalg.pinv(expected, rcond=1e-9, hermitian=True) @ off)


def _sags(common: _Common, rectangular: bool) -> tuple[Vector, Vector]:
    """Height of each face's middle over the plane through its apex and the ends of its edges, mm, and sigmas."""
    middle = 0.5 if rectangular else 1 / 3
    at = heights(np.array([[middle, middle], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), rectangular)
    by_bow = at[0] - (1 - 2 * middle) * at[1] - middle * (at[2] + at[3])
    rows = np.kron(np.eye(3), by_bow)
    one, two, three = (rows @ common.bows).tolist()
    first, second, third = np.sqrt(np.diag(rows @ common.covariance @ rows.T)).tolist()
    return (one, two, three), (first, second, third)
