"""Finder of spheres: from a scan to the centres of all spheres in it, of a known diameter or of any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, IndexArray
from calib.blas_threads import one_blas_thread
from calib.corners.intersection import packed
from calib.errors import TargetError
from calib.planes.flat_patches import flat_patches
from calib.planes.normals import NEIGHBOURS, estimate_normals
from calib.planes.point_selection import finite_rows, thin_to_voxels
from calib.scans.scan import Scan, seeded_generator
from calib.target_shapes import SPHERE_MM, Sphere, Spheres
from calib.targets.protocol.finder import FoundPoint, Wanted
from calib.targets.spheres.candidates import SphereCandidate, sphere_candidates
from calib.targets.spheres.cap_fit import CapFit, fit_cap
from calib.targets.spheres.correlated_cap import surroundings_of, with_correlated_errors
from calib.targets.spheres.doubts import FEWEST_POINTS, doubts_of, why_no_sphere

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
