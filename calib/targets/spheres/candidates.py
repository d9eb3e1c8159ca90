"""Candidates for spheres in a scan: pairs of points whose normals meet in one centre, and clusters of such centres.

Two points of a sphere with normals n_1, n_2 toward the scanner satisfy p_1 - p_2 = r (n_1 - n_2); least squares gives
r, and its residual excludes pairs that lie on no sphere (as Schnabel, Wahl and Klein 2007, section 4.1). Pairs of a
plane have equal normals and are dropped; those of a cylinder's wall or an edge agree only along a line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array
from calib.lazy_modules import spatial
from calib.planes.normals import Neighbourhoods
from calib.statistics import mad_sigma

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
