"""The angles between a jig's faces, estimated from all scans of it together, and the corners that follow from them.

All scans of a set show one jig. A single scan tells its three angles with the noise of its planes, many scans tell them
far better, and with the angles known the apex is nearly twice as certain. Whether the jig has the angles that
dataset.toml says (right angles, where it says none) is decided from the scans themselves. The angles' deviations from
these, d (3,), are

- zero, with a prior probability of 0.35 (0.98 where they are certified), or
- normal with a standard deviation t, for t from 0.02 to 0.5 degrees.

Scan k measures y_k = d + e_k, and e_k is normal with the covariance S_k of the angles between its three free planes.
Three faces look alike, so a scan does not say which angle is which where they differ by less than its noise: either
each scan's deviations are taken as a further draw, of which their common mean is the same in any order, or the angles
that the scans have in common are found together with the order of each scan's, by expectation maximisation. Two things
keep S_k / K from being believed too far: the S_k may be too small by a common factor, and errors that the scans share,
by a bow of the faces or a mixture of pixels along the edges, do not average out.

Each corner then is the mean over all of these of the corner under its angles, and its covariance says what they leave
open. It follows from the planes as they were fitted freely, so that it may be told anew with every further scan. The
angles are functions of the nine parameters of three planes with the covariance C. The best linear estimate under given
angles moves the parameters by -G y, G = C J' (J C J')^-1, where J is the angles' derivative and y their misfit; the
covariance becomes C - G J C + G W G', W that of the angles. Nine unknowns become six.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from calib.array_types import Array, IndexArray, Vector
from calib.brief import Brief
from calib.corners.faces.angles import MOST_MISFIT, angle_derivative, fitted_angles_deg, turned_normals
from calib.corners.intersection import Corner, moved_corner
from calib.jig import Jig, angles_between_deg

# That the jig has its angles. With 0.5 single scans of a jig 0.05 to 0.1 deg out of square, whose noise is as large,
# had mean squared errors of 4.5 times their covariance.
_PRIOR, _PRIOR_CERTIFIED = 0.35, 0.98
_DEVIATIONS_RAD = np.radians(np.geomspace(0.02, 0.5, 7))
_SCALES = ((1.0, 0.6), (1.5, 0.25), (2.25, 0.15))  # of all S_k, with prior probabilities
_SHARED = 0.05  # of a scan's variance, that all scans have in common
_FEWEST_TO_LEARN = 3
_STARTS, _ROUNDS = 8, 12
_OUTLYING = 9.0  # times the median squared misfit, besides that of one in 10 000
_BELIEVED, _DISPROVED = 0.5, 0.02  # probabilities of the jig's angles
_DOUBTED = 0.9  # a certificate that is less probable is warned of
_STEPS = 4
_ACROSS = np.eye(3) - 1 / 3  # of three angles, their differences from their mean


@dataclass(frozen=True)
class JigAngles(Brief):
    """Angles between the faces of one jig, as all scans of it tell them."""

    held: str  # "jig": those of dataset.toml; "scans": those that the scans have in common; "": open
    probability: float  # that the jig has the angles that dataset.toml says
    angles_deg: Vector | None  # those held; where they are the scans', in any cyclic order
    sigmas_deg: Vector | None
    scans: int  # that were counted
    outlying: tuple[str, ...]  # scans whose angles are far from all others', left free
    certified: bool

    def _brief(self) -> str:
        if self.angles_deg is None:
            return f"open after {self.scans} scans"
        return f"{', '.join(f'{angle:.4f}' for angle in self.angles_deg)} deg, by {self.scans} scans"


@dataclass(frozen=True)
class _ScanAngles:
    """Angles between the faces of one jig in K scans, less the mean of the jig's angles, rad."""

    off_rad: Array  # (K, 3) of pairs 1-2, 2-3, 3-1 of each scan's own faces
    covariance_rad2: Array  # (K, 3, 3)
    orders: IndexArray  # (K, P, 3) in which they may be those of the jig: from any face on, right-handedly
    jig_rad: Array  # (3,) the jig's

    @staticmethod
    def of(corners: Sequence[Corner], jig: Jig) -> _ScanAngles:
        """Angles in corners of free planes."""
        angles = np.radians(jig.face_angles_deg)
        found = np.radians([fitted_angles_deg(corner.faces) for corner in corners])
        derivatives = np.array([_by_planes(corner) for corner in corners])
        planes = np.array([corner.plane_covariance for corner in corners])
        handed = [np.linalg.det([face.normal for face in corner.faces]) > 0 for corner in corners]
        turned = np.where(np.array(handed)[:, None], [0, 1, 2], [2, 1, 0])
        orders = np.stack([np.roll(turned, -turn, axis=1) for turn in range(3)], axis=1)
        covariance = np.einsum("kai,kij,kbj->kab", derivatives, planes, derivatives)
        return _ScanAngles(found - angles.mean(), covariance, orders, angles - angles.mean())

    @property
    def turned_rad(self) -> Array:
        """Angles (K, P, 3) in each order."""
        return self.off_rad[np.arange(len(self.off_rad))[:, None, None], self.orders]

    def turned_covariance(self, scale: float) -> Array:
        """Covariances (K, P, 3, 3) in each order, times a factor."""
        rows = np.arange(len(self.off_rad))[:, None, None, None]
        return scale * self.covariance_rad2[rows, self.orders[..., :, None], self.orders[..., None, :]]

    def in_own_order(self, share: Array, each: Array, covariance: Array) -> tuple[Array, Array]:
        """Means (K, 3) and covariances (K, 3, 3) over the orders, with probabilities `share` (K, P).

        each  # (K, P, 3), and covariance (K, P, 3, 3), in the jig's order
        """
        rows = np.arange(len(share))[:, None, None]
        turns = np.arange(share.shape[1])[:, None]
        back = np.argsort(self.orders, axis=2)
        each = each[rows, turns, back]
        covariance = covariance[rows[..., None], turns[..., None], back[..., :, None], back[..., None, :]]
        mean = np.einsum("kp,kpi->ki", share, each)
        away = each - mean[:, None]
        spread = np.einsum("kp,kpij->kij", share, covariance + away[..., :, None] * away[..., None, :])
        return mean, 0.5 * (spread + np.swapaxes(spread, 1, 2))

    def either_way(self) -> tuple[_ScanAngles, ...]:
        """These angles in orders that go round right-handedly and, where the jig's differ, also left-handedly."""
        return (self, replace(self, orders=self.orders[:, :, ::-1])) if np.ptp(self.jig_rad) else (self,)

    def squared(self) -> Array:
        """Squared misfit (K,) of each scan in the order that fits best: 3 on average for a jig that has its angles."""
        misfits = []
        for way in self.either_way():
            weight: Array = np.asarray(np.linalg.inv(way.turned_covariance(1.0)), dtype=np.float64)
            misfits.append(_squares(way.turned_rad - way.jig_rad, weight).min(axis=1))
        return np.asarray(np.min(misfits, axis=0))

    def chosen(self, rows: IndexArray) -> _ScanAngles:
        """The scans with the given indices."""
        return _ScanAngles(self.off_rad[rows], self.covariance_rad2[rows], self.orders[rows], self.jig_rad)


@dataclass(frozen=True)
class _Component:
    """Posterior of the K scans' deviations under one hypothesis, in the order of each scan's own faces."""

    log_evidence: float
    mean: Array  # (K, 3)
    covariance: Array  # (K, 3, 3)
    common: Array  # (3,) of all scans, in their common order
    common_covariance: Array  # (3, 3)


def with_common_angles(corners: Mapping[str, Corner], jig: Jig) -> tuple[dict[str, Corner], JigAngles | None]:
    """Corners of one jig with the angles between its faces that all of them tell, and these angles.

    It makes no difference whether angles are already held in the corners. None where there is no corner.
    """
    result = {name: corner.without_held_angles for name, corner in corners.items()}
    if not result:
        return result, None
    names = list(result)
    every = _ScanAngles.of(list(result.values()), jig)
    squared = every.squared()
    counted = np.flatnonzero(squared < MOST_MISFIT + _OUTLYING * np.median(squared))
    posterior = _posterior(every.chosen(counted), jig)
    outlying = tuple(names[k] for k in range(len(names)) if k not in counted)
    angles = replace(posterior.angles, outlying=outlying)
    doubt = _doubt_of(angles, jig)
    middle = np.radians(jig.face_angles_deg).mean()
    for row, mean, covariance in zip(counted, posterior.mean, posterior.covariance, strict=True):
        held = _with_angles(result[names[row]], middle + mean, covariance)
        quality = replace(held.quality, angles_held=angles.held, notes=(*held.quality.notes, *doubt))
        result[names[row]] = replace(held, quality=quality)
    return result, angles


def _with_angles(corner: Corner, angles_rad: Array, covariance_rad2: Array) -> Corner:
    """A corner of free planes, moved to given angles (3,) between faces 1-2, 2-3, 3-1, known to a covariance (3, 3)."""
    derivative = _by_planes(corner)
    covariance = corner.plane_covariance
    gain = covariance @ derivative.T @ np.linalg.inv(derivative @ covariance @ derivative.T)
    moves = np.zeros(9)
    for _ in range(_STEPS):
        off = np.radians(angles_between_deg(turned_normals(corner.faces, moves))) - angles_rad
        moves = gain @ (derivative @ moves - off)
    covariance = covariance - gain @ derivative @ covariance + gain @ covariance_rad2 @ gain.T
    return replace(moved_corner(corner, moves, covariance), free=corner)


def _by_planes(corner: Corner) -> Array:
    """Derivatives (3, 9) of the angles between a corner's faces by the heights and slopes of its planes."""
    sine = np.sin(np.radians(fitted_angles_deg(corner.faces)))
    return angle_derivative(corner.faces) / sine[:, None]


def _doubt_of(angles: JigAngles, jig: Jig) -> tuple[str, ...]:
    """Warning on certified angles that the scans contradict, () otherwise."""
    if not jig.certified or angles.probability > _DOUBTED:
        return ()
    certified = ", ".join(f"{angle:g}" for angle in jig.face_angles_deg)
    found = ""
    if angles.held == "scans" and angles.angles_deg is not None:
        found = f"; the faces meet at {', '.join(f'{angle:.3f}' for angle in angles.angles_deg)} deg"
    scans = "this scan contradicts" if angles.scans == 1 else f"{angles.scans} scans together contradict"
    return (
        f"{scans} the certified face_angles_deg {certified} (probability {angles.probability:.2g}){found}: they "
        "are held only as far as the scans agree; measure the jig again",
    )


@dataclass(frozen=True)
class _Posterior:
    angles: JigAngles
    mean: Array  # (K, 3) deviations, rad, in the order of each scan's faces
    covariance: Array  # (K, 3, 3)


def _posterior(scans: _ScanAngles, jig: Jig) -> _Posterior:
    """Posterior of all scans' deviations, as the mixture over all hypotheses."""
    count, alike = len(scans.off_rad), np.ptp(scans.jig_rad) == 0
    prior = _PRIOR_CERTIFIED if jig.certified else _PRIOR
    components: list[tuple[str, _Component]] = []

    def add(kind: str, share: float, component: _Component) -> None:
        weighted = replace(component, log_evidence=component.log_evidence + float(np.log(share)))
        components.append((kind, weighted))

    apart = _apart if alike else _about
    for way, (scale, probable) in product(scans.either_way(), _SCALES):
        common = _common(way, scale) if count >= _FEWEST_TO_LEARN else None
        exact = apart(way, scale, 0.0) if alike or common is None else _alike(way, common, 0.0)
        add("jig", prior * probable, exact)
        share = (1 - prior) * probable / len(_DEVIATIONS_RAD) / (1 if common is None else 2)
        for deviation in _DEVIATIONS_RAD.tolist():
            add("", share, apart(way, scale, deviation))
            if common is not None:
                add("scans", share, _alike(way, common, deviation))
    weights = np.array([c.log_evidence for _, c in components])
    weights = np.exp(weights - weights.max())
    weights /= weights.sum()
    mean: Array = np.einsum("c,cki->ki", weights, np.array([c.mean for _, c in components]))
    spread: Array = np.zeros_like(scans.covariance_rad2)
    shares = {"jig": 0.0, "scans": 0.0, "": 0.0}
    for weight, (kind, c) in zip(weights.tolist(), components, strict=True):
        shares[kind] += weight
        spread += weight * (c.covariance + np.einsum("ki,kj->kij", c.mean - mean, c.mean - mean))
    disproved = shares["jig"] < _DISPROVED and shares["scans"] > shares[""]
    held = "jig" if shares["jig"] >= _BELIEVED else "scans" if disproved else ""
    angles_deg: Vector | None = None
    sigmas_deg: Vector | None = None
    if held == "jig":
        angles_deg, sigmas_deg = jig.face_angles_deg, (0.0, 0.0, 0.0)
    elif held == "scans":
        best = components[int(np.argmax(np.where([kind == held for kind, _ in components], weights, -1.0)))][1]
        one, two, three = (np.mean(jig.face_angles_deg) + np.degrees(best.common)).tolist()
        angles_deg = (one, two, three)
        one, two, three = np.degrees(np.sqrt(np.diag(best.common_covariance))).tolist()
        sigmas_deg = (one, two, three)
    return _Posterior(JigAngles(held, shares["jig"], angles_deg, sigmas_deg, count, (), jig.certified), mean, spread)


@dataclass(frozen=True)
class _Common:
    """Angles that K scans have in common, by maximum likelihood over the orders of each scan's angles."""

    weight: Array  # (K, P, 3, 3) inverse covariances in each order
    common: Array  # (3,) rad, in the common order
    information: Array  # (3, 3) inverse covariance of that, were the scans' errors independent
    log_likelihood: float  # but for its constant


def _common(scans: _ScanAngles, scale: float) -> _Common:
    """Common angles by expectation maximisation, from the jig's own and from some scans'; `scale`: of all S_k.

    Where the jig's angles are equal, the order in which the first scan's angles are counted is arbitrary.
    """
    turned = scans.turned_rad
    weight: Array = np.asarray(np.linalg.inv(scans.turned_covariance(scale)), dtype=np.float64)
    constant = 0.5 * float(np.linalg.slogdet(weight[:, 0])[1].sum())
    count, orders = turned.shape[:2]
    constant -= (count - (np.ptp(scans.jig_rad) == 0)) * float(np.log(orders))
    likeliest = np.argsort(np.trace(scans.covariance_rad2, axis1=1, axis2=2))[:_STARTS]
    best: _Common | None = None
    for common in (scans.jig_rad, *turned[likeliest, 0]):
        for _ in range(_ROUNDS):
            fits = -0.5 * _squares(turned - common, weight)
            total = np.logaddexp.reduce(fits, axis=1)
            share = np.exp(fits - total[:, None])
            information = np.einsum("kp,kpij->ij", share, weight)
            common = np.linalg.solve(information, np.einsum("kp,kpij,kpj->i", share, weight, turned))
        likelihood = float(total.sum()) + constant
        if best is None or likelihood > best.log_likelihood:
            best = _Common(weight, common, information, likelihood)
    assert best is not None
    return best


def _squares(away: Array, weight: Array) -> Array:
    """Squared deviations (K, P), from (K, P, 3) and inverse covariances (K, P, 3, 3)."""
    return np.einsum("kpi,kpij,kpj->kp", away, weight, away)


def _apart(scans: _ScanAngles, scale: float, deviation: float) -> _Component:
    """Posterior where the mean of three equal angles is common to the scans, and their differences a draw for each.

    deviation is the standard deviation of each angle, rad; `scale`: of all S_k
    """
    off, covariance = scans.off_rad, scale * scans.covariance_rad2
    prior = deviation**2 * _ACROSS
    weight: Array = np.asarray(np.linalg.inv(covariance + prior), dtype=np.float64)
    ones = np.ones(3)
    by_mean = weight @ ones  # (K, 3)
    information = float(by_mean.sum())
    mean = float(np.einsum("ki,ki->", by_mean, off)) / information
    mean_variance = deviation**2 / 3
    variance = (1 + _SHARED * len(off)) / information
    log_evidence = _log_normal(off, weight) + 0.5 * information * mean**2
    log_evidence -= 0.5 * np.log1p(mean_variance / variance) + 0.5 * mean**2 / (variance + mean_variance)
    kept = mean_variance / (variance + mean_variance)
    gain = prior @ weight  # (K, 3, 3)
    through = ones - gain @ ones
    spread = prior - gain @ prior + kept * variance * np.einsum("ki,kj->kij", through, through)
    each = np.einsum("kij,kj->ki", gain, off) + kept * mean * through
    return _Component(log_evidence, each, spread, kept * mean * ones, kept * variance * np.eye(3))


def _about(scans: _ScanAngles, scale: float, deviation: float) -> _Component:
    """Posterior where each scan's angles are a draw about the jig's, with the standard deviation `deviation`, rad."""
    away = scans.turned_rad - scans.jig_rad
    spread_with = scans.turned_covariance(scale) + deviation**2 * np.eye(3)
    weight: Array = np.asarray(np.linalg.inv(spread_with), dtype=np.float64)
    fits = 0.5 * np.linalg.slogdet(weight)[1] - 0.5 * _squares(away, weight)
    total = np.logaddexp.reduce(fits, axis=1)
    each = scans.jig_rad + deviation**2 * np.einsum("kpij,kpj->kpi", weight, away)
    covariance = deviation**2 * (np.eye(3) - deviation**2 * weight)
    mean, spread = scans.in_own_order(np.exp(fits - total[:, None]), each, covariance)
    log_evidence = float(total.sum()) - total.size * float(np.log(fits.shape[1]))
    return _Component(log_evidence, mean, spread, scans.jig_rad, np.zeros((3, 3)))


def _alike(scans: _ScanAngles, found: _Common, deviation: float) -> _Component:
    """Posterior where all scans have the same angles, which differ from the jig's with the standard deviation given."""
    turned = scans.turned_rad
    variance = (1 + _SHARED * len(turned)) * np.linalg.inv(found.information)
    wide = variance + deviation**2 * np.eye(3)
    off = found.common - scans.jig_rad
    log_evidence = found.log_likelihood - 0.5 * float(off @ np.linalg.solve(wide, off))
    log_evidence -= 0.5 * float(np.linalg.slogdet(wide)[1] - np.linalg.slogdet(variance)[1])
    gain = deviation**2 * np.linalg.inv(wide)
    common, spread = scans.jig_rad + gain @ off, gain @ variance
    fits = -0.5 * _squares(turned - common, found.weight)
    share = np.exp(fits - np.logaddexp.reduce(fits, axis=1)[:, None])
    every = np.broadcast_to(spread, (*share.shape, 3, 3))
    mean, covariance = scans.in_own_order(share, np.broadcast_to(common, turned.shape), every)
    return _Component(log_evidence, mean, covariance, common, spread)


def _log_normal(off: Array, weight: Array) -> float:
    """Log likelihood of deviations (K, 3) about zero with inverse covariances (K, 3, 3), but for its constant."""
    return 0.5 * float(np.linalg.slogdet(weight)[1].sum() - np.einsum("ki,kij,kj->", off, weight, off))
