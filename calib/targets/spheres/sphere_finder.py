"""Finder of spheres: from a scan to the centres of all spheres in it, of a known diameter or of any.

Candidates are pairs of points whose normals meet in one centre, and clusters of such centres. Each is fitted to its cap
(`cap_fit`), and refused with a reason where its surface, points seen behind it or a small cap speak against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.blas_threads import one_blas_thread
from calib.corners.intersection import packed
from calib.errors import TargetError
from calib.lazy_modules import spatial
from calib.planes.flat_patches import flat_patches
from calib.planes.normals import NEIGHBOURS, Neighbourhoods, estimate_normals
from calib.planes.point_selection import finite_rows, thin_to_voxels
from calib.planes.robust_fit import TUKEY
from calib.scans.scan import Scan, seeded_generator
from calib.statistics import mad_sigma
from calib.target_shapes import SPHERE_MM, Sphere, Spheres
from calib.targets.protocol.finder import FoundPoint, Wanted
from calib.targets.spheres.cap_fit import CapFit, fit_cap, ray_sines
from calib.targets.spheres.correlated_cap import surroundings_of, with_correlated_errors

FEWEST_POINTS = 25
_ROUGHEST = 2.5  # times the scan's noise
_SLANTED = 0.7  # sine of an incidence up to which noise hardly grows
_ROUGHEST_SLANTED = 2.3  # times the scan's noise, at that incidence
_NO_SURFACE = 0.03  # of the radius: a scatter above this is no surface's, whatever the noise
_ROUGH = 0.003  # of the radius: a scatter below this is not compared
_MOST_BEHIND = 0.3  # of the places of the silhouette, those where points lie behind the surface and none on it
_POINTS_A_CELL = 4
_MOST_LOOKED_AT = 6000  # of the points behind and about
_ABOUT = 2.5  # radii from the middle of the silhouette: neighbours of points behind, which fill a narrow cone alone
_MUCH_BEHIND = 0.25  # points behind over points on: more is no sphere if those on it err alike as well
_ERR_ALIKE = 1.5  # smooth factor
_MOST_BESIDE = 0.2  # points next to the band over points in it
_LEAST_SPREAD_DEG = 6.0  # of the normals about their mean, in the narrower direction: standard deviation
_SMALL_SPREAD_DEG, _ROUGH_AND_SMALL = 12.0, 1.6  # a cap so small has to be as smooth as flat parts are
_MOST_RADIUS_SIGMA = 0.03  # of the radius
_RADIUS_SIGMAS = 6.0  # by which a sphere's own radius may miss the declared one
_RADIUS_SLACK = 0.01  # of the radius, besides
_SMALL_CAP_DEG = 35.0


def why_no_sphere(
    points: Array, fit: CapFit, free: CapFit | None, known_mm: float | None, noise_mm: float
) -> tuple[str, float]:
    """Reason why the points (N, 3) are not on a sphere, or "", and a score of the fit.

    The score is the share of the silhouette that has points, times the radius over the sigma of the centre.
    """
    sine, depth = ray_sines(points, fit.centre_mm, fit.radius_mm)
    way = points - fit.centre_mm
    over = np.sqrt(np.einsum("ni,ni->n", way, way)) - fit.radius_mm
    near = depth < 40 * fit.radius_mm
    through = (sine < 0.9) & near
    sigma = fit.growth.sigma(sine)
    front = depth < 0
    on = through & front & (np.abs(over) < TUKEY * sigma)
    beyond = near & ~on & (depth > -np.sqrt(np.maximum(1 - sine**2, 0)) * fit.radius_mm + TUKEY * sigma)
    behind = beyond & through
    count = int(np.count_nonzero(on))
    size = f"a sphere of {2 * fit.radius_mm:.4g} mm"
    filled = _filled(points[on], fit)
    sigma_mm = float(np.sqrt(np.trace(fit.covariance_mm2[:3, :3])))
    score = filled * fit.radius_mm / max(sigma_mm, 1e-9)
    if len(fit.indices) < FEWEST_POINTS:
        return (
            f"{len(fit.indices)} points lie on {size}, at least {FEWEST_POINTS} are needed; scan it finer or nearer"
        ), score
    roughest_mm = min(max(_ROUGHEST * noise_mm, _ROUGH * fit.radius_mm), _NO_SURFACE * fit.radius_mm)
    if known_mm is not None and free is not None and free.sigma_mm < roughest_mm:
        slack_mm = _RADIUS_SIGMAS * float(np.sqrt(free.covariance_mm2[3, 3])) + _RADIUS_SLACK * known_mm
        if abs(free.radius_mm - known_mm) > slack_mm:
            score = filled * free.radius_mm / max(float(np.sqrt(np.trace(free.covariance_mm2[:3, :3]))), 1e-9)
            return (
                f"a sphere of {2 * free.radius_mm:.4g} mm is in view, diameter_mm is {2 * known_mm:g}; correct "
                "diameter_mm in dataset.toml or show the right sphere"
            ), score
    slanted_mm = float(fit.growth.sigma(np.array([_SLANTED]))[0])
    if fit.sigma_mm > roughest_mm or slanted_mm > max(_ROUGHEST_SLANTED * noise_mm, _ROUGH * fit.radius_mm):
        return (
            f"the {count} points about {size} scatter {max(fit.sigma_mm, slanted_mm):.2g} mm, those of flat parts "
            f"{noise_mm:.2g} mm: they are no sphere's; check that it is in view, and scan_sigma_mm in dataset.toml"
        ), score
    behind_mm, solid = _solid(points, behind, beyond & (sine < _ABOUT))
    seen_through = _seen_through(points[on], behind_mm, solid, fit)
    surfaces = round(float(np.mean(solid)) * np.count_nonzero(behind)) if len(solid) else 0
    much = surfaces > _MUCH_BEHIND * count and fit.smooth_factor > _ERR_ALIKE
    if seen_through > _MOST_BEHIND or much:
        return (
            f"{surfaces} points of surfaces lie behind {size} that {count} points lie on, which could not be seen: "
            "it is none; check that the sphere is in view"
        ), score
    beside = through & front & (np.abs(over) >= TUKEY * sigma) & (np.abs(over) < 3 * TUKEY * sigma)
    errs_alike = fit.smooth_factor > _ERR_ALIKE
    if np.count_nonzero(beside) > (0.5 if errs_alike else 1.0) * _MOST_BESIDE * count:
        return (
            f"the surface bends away from {size} that {count} of its points lie on: it is no sphere; check that one is "
            "in view"
        ), score
    spread = _spread_deg(points[on] - fit.centre_mm)
    if spread < _SMALL_SPREAD_DEG and fit.sigma_mm > _ROUGH_AND_SMALL * noise_mm:
        return (
            f"the {count} points about a cap of {size} scatter {fit.sigma_mm:.2g} mm, flat parts {noise_mm:.2g} mm: so "
            "small a cap may be anything's; clear the view to it, or scan it from where more is seen"
        ), score
    if spread < _LEAST_SPREAD_DEG:
        return (
            f"the {count} points on {size} cover a strip or a cap of {spread:.1f} deg only, at least "
            f"{_LEAST_SPREAD_DEG:g} deg are needed; clear the view to it, or scan it from where more is seen"
        ), score
    if free is not None and known_mm is None:
        radius_sigma_mm = float(np.sqrt(free.covariance_mm2[3, 3]))
        if radius_sigma_mm > _MOST_RADIUS_SIGMA * free.radius_mm:
            return (
                f"{count} points tell the sphere's diameter to {2 * radius_sigma_mm:.2g} mm only; give diameter_mm in "
                "dataset.toml, or scan more of the sphere"
            ), score
    return "", score


def _filled(points: Array, fit: CapFit) -> float:
    """Share of the silhouette's disc, in cells, that has points (K, 3)."""
    return float(len(np.unique(_cells(points, fit, 6))) / 113.0)  # 6^2 pi cells lie in the disc


def _cells(points: Array, fit: CapFit, half: int) -> IndexArray:
    """Index (K,) of the cell of the silhouette's disc, 2 `half` cells wide, that each point's ray goes through."""
    away = float(np.linalg.norm(fit.centre_mm))
    axes = np.linalg.svd(fit.centre_mm[None])[2][1:]
    rays = points @ axes.T / np.maximum(points @ fit.centre_mm / away**2, 1e-9)[:, None]
    cells = np.clip(np.floor((rays / fit.radius_mm + 1) * half), 0, 2 * half - 1).astype(np.int64)
    return cells[:, 0] * 2 * half + cells[:, 1]


def _solid(points: Array, behind: BoolArray, about: BoolArray) -> tuple[Array, BoolArray]:
    """Some of the points (N, 3) that lie behind, and which of them lie on a surface, by all that lie there and about.

    The others are stray points, which fill space.
    """
    there = np.flatnonzero(about)
    there = there[:: max(1, len(there) // _MOST_LOOKED_AT)]
    mine = behind[there]
    if len(there) < NEIGHBOURS:
        return points[there[mine]], np.zeros(np.count_nonzero(mine), dtype=bool)
    return points[there[mine]], ~estimate_normals(points[there]).loose()[mine]


def _seen_through(on: Array, behind: Array, solid: BoolArray, fit: CapFit) -> float:
    """Ratio of the silhouette's cells with a surface only behind the sphere's to its cells with points on that.

    on, behind  # (K, 3), (M, 3). Stray points lie behind a true sphere too, in its shadow and in that of what hides it:
    a cell counts where most of the points behind are on a surface.
    """
    half = int(np.clip(np.sqrt(len(on) / _POINTS_A_CELL / np.pi), 2, 8))
    there = np.unique(_cells(on, fit, half))
    beyond, cell = np.unique(_cells(behind, fit, half), return_inverse=True)
    beyond = beyond[np.bincount(cell, solid) > 0.5 * np.bincount(cell)]
    return float(len(np.setdiff1d(beyond, there)) / max(len(there), 1))


def _spread_deg(outward: Array) -> float:
    """Standard deviation in deg of the directions (K, 3) about their mean, in the narrower direction."""
    if len(outward) < 3:
        return 0.0
    unit = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    values = np.linalg.eigvalsh(np.cov(unit.T))
    return float(np.degrees(np.sqrt(max(values[1], 0.0))))


def doubts_of(fit: CapFit, *, fixed: bool) -> tuple[str, ...]:
    """Warnings about a sphere that was found, each with a remedy."""
    warnings = []
    if fit.cap_deg < _SMALL_CAP_DEG and not fixed:
        warnings.append(
            f"only a cap of {fit.cap_deg:.0f} deg is seen, which hardly separates centre and diameter; give diameter_mm"
        )
    if fit.smooth_factor > 2:
        warnings.append(
            f"neighbouring points err alike, which makes the centre {fit.smooth_factor:.1f} times less certain; the "
            "sphere is not round, or the scanner's error is smooth"
        )
    return tuple(warnings)


_MOST_TRIED = 12
_PAIRS_A_POINT = 6
_MOST_PAIRS = 240_000
_LEAST_TURN = 0.12  # between the two normals, rad
_MOST_LEFT = 0.3  # of the distance between the two points, what r (n_1 - n_2) leaves of it
_GATHER = 0.15  # of the radius: centres that lie so near are one
_RADIUS_STEP = 1.25
_FEWEST_VOTES = 12
_BAND = 0.12  # of the radius, of the first fit
_NORMALS_RAD = np.radians(35)


@dataclass(frozen=True)
class SphereCandidate:
    """Sphere that some thinned points lie on."""

    centre_mm: Array  # (3,)
    radius_mm: float
    votes: int  # thinned points on it whose normals agree
    band_mm: float  # within which those lie


def sphere_candidates(
    around: Neighbourhoods, radii_mm: tuple[float, float], rng: np.random.Generator
) -> list[SphereCandidate]:
    """Spheres with a radius in the given range, those with most points first, at most `_MOST_TRIED` of them."""
    centres, radii = _votes(around, radii_mm, rng)
    candidates: list[SphereCandidate] = []
    for centre, radius in _peaks(centres, radii, radii_mm):
        settled = _settled(around, centre, radius, radii_mm)
        if settled is None:
            continue
        if all(np.linalg.norm(settled.centre_mm - other.centre_mm) > 0.4 * settled.radius_mm for other in candidates):
            candidates.append(settled)
    return sorted(candidates, key=lambda h: -h.votes)[:_MOST_TRIED]


def _votes(around: Neighbourhoods, radii_mm: tuple[float, float], rng: np.random.Generator) -> tuple[Array, Array]:
    """Centres (K, 3) and radii (K,) of spheres through pairs of nearby points, by the points' normals.

    The two points of a pair are one to three steps from neighbour to neighbour apart.
    """
    count, neighbours = len(around.points_mm), around.neighbours
    draws = min(_PAIRS_A_POINT, max(1, _MOST_PAIRS // count))
    first = np.tile(np.arange(count), draws)
    second = first
    for step in range(3):
        onward = neighbours[second, rng.integers(1, neighbours.shape[1], len(second))]
        second = np.where(rng.random(len(first)) < (1.0, 0.8, 0.5)[step], onward, second)
    apart = around.points_mm[first] - around.points_mm[second]
    turn = around.normals[first] - around.normals[second]
    square = np.einsum("ki,ki->k", turn, turn)
    radius = np.einsum("ki,ki->k", apart, turn) / np.maximum(square, 1e-12)
    residual = np.linalg.norm(apart - radius[:, None] * turn, axis=1)
    good = square > _LEAST_TURN**2
    good &= residual < _MOST_LEFT * np.linalg.norm(apart, axis=1)
    good &= (radius > 0.8 * radii_mm[0]) & (radius < 1.25 * radii_mm[1])
    first, second, radius = first[good], second[good], radius[good]
    middle = around.points_mm[first] + around.points_mm[second]
    towards = around.normals[first] + around.normals[second]
    return 0.5 * (middle - radius[:, None] * towards), radius


def _peaks(centres: Array, radii: Array, radii_mm: tuple[float, float]) -> list[tuple[Array, float]]:
    """Centres and radii where many votes meet, those with most votes first.

    Ranges of radii are searched one after the other.
    """
    peaks: list[tuple[int, Array, float]] = []
    low = 0.8 * radii_mm[0]
    while low < 1.25 * radii_mm[1]:
        high = low * _RADIUS_STEP**2
        inside = np.flatnonzero((radii >= low) & (radii < high))
        if len(inside) >= _FEWEST_VOTES:
            here, reach = centres[inside], _GATHER * np.sqrt(low * high)
            tree = spatial.cKDTree(here)
            some = here[:: max(1, len(here) // 4000)]
            count = np.asarray(tree.query_ball_point(some, reach, return_length=True))
            free = np.ones(len(some), dtype=bool)
            for _ in range(_MOST_TRIED // 2):
                best = int(np.argmax(np.where(free, count, 0)))
                if not free[best] or count[best] < _FEWEST_VOTES:
                    break
                members = tree.query_ball_point(some[best], reach)
                centre = np.median(here[members], axis=0)
                peaks.append((int(count[best]), centre, float(np.median(radii[inside][members]))))
                free &= np.linalg.norm(some - some[best], axis=1) > 2 * reach
        low *= _RADIUS_STEP
    peaks.sort(key=lambda peak: -peak[0])
    return [(centre, radius) for _, centre, radius in peaks]


def _settled(
    around: Neighbourhoods, centre: Array, radius: float, radii_mm: tuple[float, float]
) -> SphereCandidate | None:
    """Sphere by robust least squares on thinned points whose normals agree, from a first guess; None for few points."""
    points, normals = around.points_mm, around.normals
    votes, share = 0, 2 * _BAND
    for _ in range(8):
        way = points - centre
        reach = np.sqrt(np.einsum("ni,ni->n", way, way))
        agree = np.einsum("ni,ni->n", way, normals) > np.cos(_NORMALS_RAD) * reach
        on = agree & (np.abs(reach - radius) < share * radius)
        votes = int(np.count_nonzero(on))
        if votes < _FEWEST_VOTES:
            return None
        rows = np.column_stack([way[on] / reach[on, None], np.ones(votes)])
        over = reach[on] - radius
        scale = max(mad_sigma(over - np.median(over)), 1e-3 * radius)
        weight = np.clip(1 - (over / (6 * scale)) ** 2, 0, None) ** 2
        normal = rows.T @ (rows * weight[:, None]) + 1e-6 * votes * np.eye(4)
        step = np.linalg.solve(normal, rows.T @ (weight * over))
        size = float(np.linalg.norm(step[:3]))
        step *= min(1.0, 0.3 * radius / max(size, 1e-9))
        centre, radius = (centre + step[:3], float(np.clip(radius + step[3], 0.8 * radii_mm[0], 1.25 * radii_mm[1])))
        share = float(np.clip(6 * scale / radius, 0.02, share))
    return SphereCandidate(centre, radius, votes, share * radius)


_VOXELS_A_RADIUS = (7.0, 12.0, 4.0)  # of the passes, until one finds as many as are wanted
_RANGE_STEP = 4.0  # of the radii that are looked for at one size of voxels
_LEAST_BAND = 0.012  # of the radius
_MOST_FLAT = 20_000  # points of the scan in which flat surroundings are looked for
_FLAT_SIZE = 6.0  # radii, of those
_MOST_OVER_DECLARED = 1.5  # times the declared noise, that a scan may have


@dataclass(frozen=True)
class _FittedSphere:
    """Fit of a candidate, with the reason against it or "", and its score."""

    fit: CapFit
    refusal: str
    score: float


@one_blas_thread()
def find_spheres(scan: Scan, wanted: Wanted) -> Sequence[FoundPoint]:
    """Centres of at most as many spheres as are wanted, the surest first.

    With a known diameter the radius is fixed in the fit, and a sphere whose own radius disagrees is no candidate.
    Raises TargetError where there is none.
    """
    shape, most = wanted.shape, wanted.most
    assert isinstance(shape, Sphere | Spheres)
    points = scan.points_mm[finite_rows(scan.points_mm)]
    if len(points) < FEWEST_POINTS:
        raise TargetError(
            f"the scan holds {len(points)} points, a sphere needs at least {FEWEST_POINTS}; scan the pose again, finer"
        )
    rng = seeded_generator(points)
    known_mm = None if shape.diameter_mm is None else shape.diameter_mm / 2
    accepted: list[_FittedSphere] = []
    refused: list[_FittedSphere] = []
    for voxels in _VOXELS_A_RADIUS:
        for candidate, noise_mm in _guesses(points, known_mm, voxels, rng):
            declared_mm = wanted.scan_sigma_mm
            if declared_mm is not None:  # stray points make flat parts look rougher than they are
                noise_mm = max(declared_mm, min(noise_mm, _MOST_OVER_DECLARED * declared_mm))
            tried = _fitted(points, candidate, known_mm, noise_mm)
            if tried is None:
                continue
            (refused if tried.refusal else accepted).append(tried)
        accepted = _apart(accepted)
        if len(accepted) >= most:
            break
    if not accepted:
        if not refused:
            raise TargetError(
                f"no {_shape_text(shape)} among {len(points)} points; check that it is in view, and diameter_mm in "
                "dataset.toml"
            )
        best = max(refused, key=lambda tried: tried.score)
        raise TargetError(best.refusal)
    finite = np.flatnonzero(finite_rows(scan.points_mm))
    chosen = [tried.fit for tried in accepted[:most]]
    flat = flat_patches(points[:: max(1, len(points) // _MOST_FLAT)], _FLAT_SIZE * chosen[0].radius_mm)
    fits = [with_correlated_errors(points, fit, wanted.declared, surroundings_of(points, flat, fit)) for fit in chosen]
    return [_found(fit, finite, len(scan.points_mm), shape) for fit in fits]


def _shape_text(shape: Sphere | Spheres) -> str:
    """ "sphere", or "sphere of 38 mm"."""
    return "sphere" if shape.diameter_mm is None else f"sphere of {shape.diameter_mm:g} mm"


def _guesses(
    points: Array, known_mm: float | None, voxels: float, rng: np.random.Generator
) -> list[tuple[SphereCandidate, float]]:
    """Candidate spheres from a scan's thinned points, each with the noise, mm, of the scan's flat parts."""
    ranges = [(known_mm, known_mm)] if known_mm is not None else _radius_ranges(points)
    guesses: list[tuple[SphereCandidate, float]] = []
    for low, high in ranges:
        middle = np.sqrt(low * high)
        thinned = thin_to_voxels(points, middle / voxels)
        if len(thinned) < NEIGHBOURS:
            continue
        around = estimate_normals(points[thinned])
        guesses += [(h, around.noise_mm()) for h in sphere_candidates(around, (low, high), rng)]
    return guesses


def _radius_ranges(points: Array) -> list[tuple[float, float]]:
    """Ranges of the radii of spheres that a scan of this extent may show."""
    low, high = SPHERE_MM[0] / 2, SPHERE_MM[1] / 2
    some = points[:: max(1, len(points) // 10_000)]
    extent = float(np.ptp(np.quantile(some, [0.02, 0.98], axis=0), axis=0).max())
    low = max(low, extent / 100)
    high = min(high, extent)
    ranges = []
    while low < high:
        ranges.append((low, min(low * _RANGE_STEP, high)))
        low *= _RANGE_STEP
    return ranges or [(SPHERE_MM[0] / 2, SPHERE_MM[1] / 2)]


def _fitted(points: Array, guess: SphereCandidate, known_mm: float | None, noise_mm: float) -> _FittedSphere | None:
    """Candidate fitted to all its points, with the reason against it or ""; None where the fit fails."""
    band = max(guess.band_mm, _LEAST_BAND * guess.radius_mm)
    free = fit_cap(points, guess.centre_mm, guess.radius_mm, band, fixed=False)
    if free is None and known_mm is None:
        return None
    fixed = None
    if known_mm is not None:
        start = guess.centre_mm if free is None else free.centre_mm
        fixed = fit_cap(points, start, known_mm, band, fixed=True)
    fit = free if fixed is None else fixed
    if fit is None:
        return None
    refusal, score = why_no_sphere(points, fit, free, known_mm, noise_mm)
    if known_mm is not None and fixed is None and not refusal:
        return None
    return _FittedSphere(fit, refusal, score)


def _apart(tried: Sequence[_FittedSphere]) -> list[_FittedSphere]:
    """Fits ordered from the best, without those at the place of a better fit."""
    best: list[_FittedSphere] = []
    for one in sorted(tried, key=lambda t: -t.score):
        if all(
            np.linalg.norm(one.fit.centre_mm - other.fit.centre_mm) > 0.5 * max(one.fit.radius_mm, other.fit.radius_mm)
            for other in best
        ):
            best.append(one)
    return best


def _found(fit: CapFit, finite: IndexArray, count: int, shape: Sphere | Spheres) -> FoundPoint:
    """Place of a fitted sphere's centre; `finite` are the indices in the scan of the points that were fitted."""
    facts = {"diameter_mm": 2 * fit.radius_mm, "cap_deg": fit.cap_deg, "smooth_factor": fit.smooth_factor}
    if shape.diameter_mm is None:
        facts["diameter_sigma_mm"] = 2 * float(np.sqrt(fit.covariance_mm2[3, 3]))
    return FoundPoint(
        fit.centre_mm,
        fit.covariance_mm2[:3, :3],
        len(fit.indices),
        fit.sigma_mm,
        packed(finite[fit.indices], count),
        facts,
        doubts_of(fit, fixed=shape.diameter_mm is not None),
        fit.radius_mm,
    )
