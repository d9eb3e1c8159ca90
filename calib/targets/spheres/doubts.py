"""Reasons to refuse a fitted sphere, and warnings about an accepted one: surface, points seen behind, a small cap."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.planes.normals import NEIGHBOURS, estimate_normals
from calib.planes.robust_fit import TUKEY
from calib.targets.spheres.cap_fit import CapFit, ray_sines

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
