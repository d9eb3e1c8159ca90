"""A sphere's centre from all points of its cap: robust orthogonal distances, each weighted by its noise.

A scanner's noise lies along the ray and grows with the incidence i, so the distances to the surface scatter by a
sigma(i) that is estimated from them. Four things would shift a centre by more than its noise:

- pixels at the silhouette lie between the sphere and what is behind it: a margin along the silhouette is left out, by
  the rays and not by the measured points, which would choose the points by their noise;
- an error e along the ray moves a point sideways as well, by which its distance from the centre grows by
  e^2 sin^2 i / (2 r) and its normal turns with its error: a radius that is free comes out too small. So the surface is
  met where the ray meets it, and the distance is e cos i, which has neither;
- a pixel that averages over its footprint, of variance v in each direction, lies inside of a sphere, which is curved:
  by v (1 + 1 / cos^2 i) / 2 r to second order. Where the distances show such a v it is fitted with the centre;
- near what holds the sphere (a stem, a socket) points belong to neither surface: places where most points about the
  sphere's surface lie off it are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array_types import Array, BoolArray, IndexArray
from calib.lazy_modules import spatial
from calib.planes.robust_fit import TUKEY
from calib.statistics import mad_sigma

LEAST_SIGMA_MM = 1e-6  # of a scan without noise
_BINS = 12
_POINTS_A_BIN = 25
_MOST_GROWTH = 12.0
_PATCHES = 48
_PLAIN = 1.5  # a ratio of variances below this is that of white noise in some tens of patches
_LEAST_COSINE_OF_NOISE = 0.15


@dataclass(frozen=True)
class NoiseGrowth:
    """Sigma of the distances over the surface by incidence i: sigma_mm exp(b_1 g + b_2 g^2), g = -log cos i."""

    sigma_mm: float  # seen squarely
    powers: Array  # (2,) b_1, b_2

    def sigma(self, sine: Array) -> Array:
        """Sigmas (K,) of the distances, mm, for sines (K,) of the incidence."""
        g = _lean(sine)
        return self.sigma_mm * np.clip(np.exp(self.powers[0] * g + self.powers[1] * g**2), 0.5, _MOST_GROWTH)


def _lean(sine: Array) -> Array:
    """Measure g = -log cos i (K,) of the incidence i, from sines (K,) of the incidence."""
    return -0.5 * np.log(np.maximum(1 - np.minimum(sine, 1.0) ** 2, _LEAST_COSINE_OF_NOISE**2))


def growth_of(over: Array, sine: Array) -> NoiseGrowth:
    """Growth of the noise with the incidence: MAD of the distances over the surface (K,) in bins of the incidence.

    Some of the distances may be no noise. Few points show one sigma, more show its growth, many show its curvature.
    """
    middle = float(np.median(over))
    level = max(mad_sigma(over - middle), LEAST_SIGMA_MM)
    bins = min(_BINS, len(over) // _POINTS_A_BIN)
    if bins < 3:
        return NoiseGrowth(level, np.zeros(2))
    order = np.argsort(sine)
    parts = np.array_split(order, bins)
    lean = np.array([float(np.mean(_lean(sine[part]))) for part in parts])
    spread = np.array([mad_sigma(over[part] - middle) for part in parts])
    count = np.array([len(part) for part in parts])
    log = np.log(np.maximum(spread, LEAST_SIGMA_MM))
    powers = 2 if bins >= 8 else 1
    design = np.column_stack([np.ones(bins), *(lean**k for k in range(1, powers + 1))])
    # A prior that the noise does not grow, of one bin's weight, keeps the curve from bending after a bad bin.
    penalty = np.diag([0.0, *([0.02] * powers)]) * count.mean()
    weighted = design.T * count
    solution = np.linalg.solve(weighted @ design + penalty, weighted @ log)
    bends = np.zeros(2)
    bends[:powers] = solution[1:]
    return NoiseGrowth(max(float(np.exp(solution[0])), LEAST_SIGMA_MM), bends)


def patch_factor(rows: Array, psi: Array, inverse: Array) -> float:
    """Factor by which errors correlated within patches enlarge the parameters' sigma; 1 where they do not.

    rows # (K, p) of the design over sigma, psi (K,) weighted residuals over sigma, inverse (p, p). Correlated errors of
    neighbours make the sums of a patch larger than those of independent points (the cluster-robust covariance, Liang
    and Zeger 1986). A form error of the sphere is included; an error that is smooth over the whole cap is not.
    """
    if len(rows) < 4 * _PATCHES:
        return 1.0
    patch = _patches(rows)
    sums = np.column_stack([np.bincount(patch, rows[:, k] * psi, minlength=_PATCHES) for k in range(rows.shape[1])])
    whole = inverse @ (sums.T @ sums) @ inverse
    alone = inverse @ ((rows * (psi**2)[:, None]).T @ rows) @ inverse
    lost = 1 - rows.shape[1] / np.count_nonzero(np.bincount(patch, minlength=_PATCHES))
    ratio = float(np.trace(whole[:3, :3]) / max(np.trace(alone[:3, :3]), 1e-300)) / max(lost, 0.5)
    return float(np.sqrt(ratio)) if ratio > _PLAIN else 1.0


def _patches(rows: Array) -> IndexArray:
    """Number (K,) of each point's patch: quantiles along two axes across the cap."""
    way = rows[:, :3] / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    centred = way - way.mean(axis=0)
    across = centred @ np.linalg.svd(centred[:: max(1, len(centred) // 2000)], full_matrices=False)[2][:2].T
    columns = 6
    column = np.searchsorted(np.quantile(across[:, 0], np.arange(1, columns) / columns), across[:, 0])
    patch = np.zeros(len(rows), dtype=np.int64)
    for k in range(columns):
        on = column == k
        each = _PATCHES // columns
        cuts = np.quantile(across[on, 1], np.arange(1, each) / each)
        patch[on] = k * each + np.searchsorted(cuts, across[on, 1])
    return patch


_ROUNDS = 18
_SETTLED = 1e-3  # of the centre's own sigma
_MOST_INCIDENCE_DEG = 80.0
_MARGINS_PIXELS = (0.35, 1.6)  # left out along the silhouette, in distances between neighbouring points
_RING_SIGMAS = 3.5  # the mean distance of the points between those two margins that makes the margin the wider one
_MARGIN_ROUND, _RING_ROUND, _BLUR_ROUND = 2, 5, 8
_BLUR_SIGMAS = 3.5  # of a blur that is taken for one
_TYPICAL_BLUR = 0.25  # squared distances between neighbouring points: variance of a pixel's footprint
_LEAST_COSINE = 0.2
_BAND_SIGMA = 12.0
_FEWEST_POINTS = 12
_NEIGHBOURS = 12
_MOST_OFF = 0.34  # share of the points about a place of the surface that may lie off it
_SHELL = 0.25  # of the radius: how far off the surface points are looked at for that


@dataclass(frozen=True)
class CapFit:
    """Sphere fitted to the points of its cap."""

    centre_mm: Array  # (3,) scanner frame
    radius_mm: float
    covariance_mm2: Array  # (4, 4) of centre and radius; the row of a fixed radius is zero
    indices: IndexArray  # (K,) into the points, those with a weight
    distances_mm: Array  # (K,) over the surface
    sine: Array  # (K,) of the incidence of each point's ray
    sigma_mm: float  # of the distances, seen squarely: 1.4826 MAD
    growth: NoiseGrowth
    smooth_factor: float  # sigma of the centre over what white noise alone would make it
    design: Array  # (K, P) derivatives of the distances by centre, radius where it is free, blur where there is one
    pseudo_mm: Array  # (K,) distances as the fit takes them: times Tukey's weight, over the mean of psi'
    fixed: bool  # whether the radius was given
    unfitted_mm2: Array  # (4, 4) share of the covariance by a blur that the distances neither show nor rule out

    @property
    def cap_deg(self) -> float:
        """Half angle, deg, of the visible cap: the incidence below which nine in ten of the points lie."""
        return float(np.degrees(np.arcsin(min(float(np.quantile(self.sine, 0.9)), 1.0))))


def ray_sines(points: Array, centre: Array, radius: float) -> tuple[Array, Array]:
    """Sine (N,) of each ray's incidence on the sphere, above 1 where the ray misses, and each point's depth (N,).

    The depth is that of the point along its ray, before (below 0) or behind the sphere's middle. The sine is the ray's
    distance from the centre over the radius, so that it does not depend on the noise along the ray.
    """
    length = np.sqrt(np.einsum("ni,ni->n", points, points))
    along = points @ centre / np.maximum(length, 1e-9)
    miss = np.sqrt(np.maximum(centre @ centre - along**2, 0.0))
    return miss / radius, length - along


def fit_cap(points: Array, centre: Array, radius: float, band_mm: float, *, fixed: bool) -> CapFit | None:
    """Fit of centre and radius to the cap's points, from a start accurate to `band_mm`; None where the fit fails.

    points  # (N, 3) scanner frame, the scanner at the origin. The radius stays as given where it is `fixed`. None where
    fewer than 12 points are on the sphere, or where they do not define it.
    """
    near = np.flatnonzero(_within(points, centre, radius, max(1.5 * band_mm, _SHELL * radius)))
    local = points[near]
    most_sine = np.sin(np.radians(_MOST_INCIDENCE_DEG))
    clear: BoolArray = np.ones(len(near), dtype=bool)
    growth = NoiseGrowth(max(band_mm / _BAND_SIGMA, LEAST_SIGMA_MM), np.zeros(2))
    pixel = blur_mm2 = 0.0
    blurred = False
    for turn in range(_ROUNDS):
        sine, _ = ray_sines(local, centre, radius)
        outward = local - centre
        reach = np.sqrt(np.einsum("ni,ni->n", outward, outward))
        front = np.einsum("ni,ni->n", outward, local) < 0
        over, normals = reach - radius, outward / np.maximum(reach, 1e-9)[:, None]
        if turn >= _MARGIN_ROUND:
            over, normals = _met_by_rays(local, centre, radius, sine, over, normals)
        bend = _bend(sine, radius)
        over = over - blur_mm2 * bend
        sigma = growth.sigma(sine)
        on = clear & front & (sine < most_sine) & (np.abs(over) < max(band_mm, 1e-9) * sigma / growth.sigma_mm)
        if np.count_nonzero(on) < _FEWEST_POINTS:
            return None
        if turn == _MARGIN_ROUND:
            pixel = _spacing(local[on], centre, radius) / radius
            most_sine = min(most_sine, 1 - _MARGINS_PIXELS[0] * pixel)
            clear = _clear_of_others(normals, over, sigma)
        elif turn == _RING_ROUND and _is_lifted(over[on] / sigma[on], sine[on] > 1 - _MARGINS_PIXELS[1] * pixel):
            most_sine = min(most_sine, 1 - _MARGINS_PIXELS[1] * pixel)
            on &= sine < most_sine
            if np.count_nonzero(on) < _FEWEST_POINTS:
                return None
        growth = growth_of(over[on], sine[on])
        sigma = growth.sigma(sine[on])
        weight = np.clip(1 - (over[on] / (TUKEY * sigma)) ** 2, 0, None) ** 2
        free = [] if fixed else [np.ones(np.count_nonzero(on))]
        if turn == _BLUR_ROUND:
            trial = np.column_stack([normals[on], *free, bend[on]])
            blurred = _shows_blur(trial / sigma[:, None], over[on] / sigma, weight)
        rows = np.column_stack([normals[on], *free, *([bend[on]] if blurred else [])])
        normal = rows.T @ (rows * (weight / sigma**2)[:, None])
        step, _ = _step(normal, rows.T @ (weight / sigma**2 * over[on]))
        if step is None:
            return None
        centre = centre + step[:3]
        radius = radius if fixed else radius + float(step[3])
        blur_mm2 += float(step[-1]) if blurred else 0.0
        if radius <= 0 or not np.isfinite(radius):
            return None
        band_mm = _BAND_SIGMA * growth.sigma_mm
        if turn > _BLUR_ROUND and step @ normal @ step < _SETTLED**2 * len(step):
            break
    kept = weight > 0
    indices, rows, sigma = near[on][kept], rows[kept], sigma[kept]
    root = np.sqrt(weight[kept])
    slope = float(np.mean(root * (5 * root - 4)))  # mean of psi', as for planes
    psi = weight[kept] * over[on][kept] / sigma
    freedom = max(len(psi) - rows.shape[1], 1)
    information = rows.T @ (rows / sigma[:, None] ** 2)
    _, inverse = _step(information, np.zeros(rows.shape[1]))
    white = inverse * float(psi @ psi) / freedom / slope**2
    factor = patch_factor(rows / sigma[:, None], psi, inverse)
    covariance = np.zeros((4, 4))
    known = 3 if fixed else 4
    covariance[:known, :known] = white[:known, :known] * factor**2
    unfitted = np.zeros((4, 4))
    if not blurred:
        noise = sigma * np.sqrt(float(psi @ psi) / freedom) / slope
        bent = _bend(sine[on][kept], radius)
        typical_mm2 = _TYPICAL_BLUR * (pixel * radius) ** 2
        unfitted[:known, :known] = _unfitted_blur(rows, bent, psi * sigma / slope, noise, typical_mm2)
        covariance += unfitted
    return CapFit(
        centre, radius, covariance, indices, over[on][kept], sine[on][kept], growth.sigma_mm, growth, factor,
        rows, psi * sigma / slope, fixed, unfitted,
    )  # fmt: skip


def _bend(sine: Array, radius: float) -> Array:
    """Mean height (N,) of points over a sphere when blurred with a variance of 1 mm^2: -(1 + 1 / cos^2 i) / 2 r."""
    square = np.maximum(1 - np.minimum(sine, 1.0) ** 2, _LEAST_COSINE**2)
    return -(1 + 1 / square) / (2 * radius)


def _shows_blur(rows: Array, over: Array, weight: Array) -> bool:
    """Whether the coefficient of the blur, last column of the weighted design (K, p), is significantly above 0."""
    step, inverse = _step(rows.T @ (rows * weight[:, None]), rows.T @ (weight * over))
    return step is not None and bool(step[-1] > _BLUR_SIGMAS * np.sqrt(inverse[-1, -1]))


def _unfitted_blur(rows: Array, bend: Array, values: Array, sigma: Array, typical_mm2: float) -> Array:
    """Covariance (P, P) of the parameters by a blur that was left out, from the distances' design (K, P) and `bend`.

    Expected squared blur times the squares of what it moves: the blur is either 0 or has a normal prior of
    `typical_mm2`, with the same probability, and its estimate from the residuals (K,) gives the odds.
    """
    weighted = rows / sigma[:, None] ** 2
    _, inverse = _step(weighted.T @ rows, np.zeros(rows.shape[1]))
    moves = inverse @ (weighted.T @ bend)
    left = bend - rows @ moves
    information = float(left @ (left / sigma**2))
    if information <= 0 or typical_mm2 <= 0:
        return np.zeros_like(inverse)
    estimate, variance = float(left @ (values / sigma**2)) / information, 1 / information
    shrunk = typical_mm2**2 / (typical_mm2**2 + variance)
    odds = np.sqrt(1 - shrunk) * np.exp(min(0.5 * shrunk * estimate**2 / variance, 100.0))
    squared = odds / (1 + odds) * ((shrunk * estimate) ** 2 + shrunk * variance)
    return squared * np.outer(moves, moves)


def _within(points: Array, centre: Array, radius: float, band_mm: float) -> BoolArray:
    """Mask (N,): whether points (N, 3) lie within `band_mm` of the sphere's surface."""
    way = points - centre
    return np.abs(np.sqrt(np.einsum("ni,ni->n", way, way)) - radius) < band_mm


def _spacing(points: Array, centre: Array, radius: float) -> float:
    """Distance between neighbouring points (K, 3) across the line of sight, from their density in the silhouette."""
    sine, _ = ray_sines(points, centre, radius)
    inner = np.sort(sine)[: max(len(sine) // 2, 6)]
    across = points - centre
    sight = centre / np.linalg.norm(centre)
    flat = across - np.outer(across @ sight, sight)
    some = flat[np.argsort(sine)[: len(inner)]]
    if len(some) > 4000:
        some = some[:: len(some) // 4000 + 1]
        inner_share = len(inner) / len(some)
    else:
        inner_share = 1.0
    near = np.asarray(spatial.cKDTree(some).query(some, k=min(5, len(some)))[0])[:, -1]
    return float(np.median(near) * np.sqrt(np.pi / 4) / np.sqrt(inner_share))


def _met_by_rays(
    points: Array, centre: Array, radius: float, sine: Array, over: Array, normals: Array
) -> tuple[Array, Array]:
    """Distances (N,) of points over the sphere, and its normals (N, 3), where rays meet it; else as given."""
    meets = sine < 1
    length = np.sqrt(np.einsum("ni,ni->n", points, points))
    ways = points[meets] / length[meets, None]
    cosine = np.sqrt(1 - sine[meets] ** 2)
    depth = ways @ centre - radius * cosine
    over, normals = over.copy(), normals.copy()
    over[meets] = (depth - length[meets]) * cosine
    normals[meets] = (ways * depth[:, None] - centre) / radius
    return over, normals


def _is_lifted(over_sigmas: Array, ring: BoolArray) -> bool:
    """Whether the points of the ring along the silhouette lie off the sphere, as blurred pixels do."""
    inside = np.clip(over_sigmas[ring], -TUKEY, TUKEY)
    if len(inside) < 4:
        return False
    spread = max(float(np.std(inside)), 0.7)
    return bool(abs(inside.mean()) > _RING_SIGMAS * spread / np.sqrt(len(inside)))


def _clear_of_others(direction: Array, over: Array, sigma: Array) -> BoolArray:
    """Mask (K,): most neighbours of a point lie on the sphere, not another object; `direction` (K, 3): outward."""
    off = np.abs(over) > TUKEY * sigma
    if not off.any():
        return np.ones(len(over), dtype=bool)
    k = min(_NEIGHBOURS, len(direction))
    step = max(1, len(direction) // 30_000)
    tree = spatial.cKDTree(direction[::step])
    near = np.asarray(tree.query(direction, k=k)[1]).reshape(len(direction), k)
    return off[::step][near].mean(axis=1) <= max(_MOST_OFF, 1.5 * off.mean())


def _step(normal: Array, right: Array) -> tuple[Array | None, Array]:
    """Solution of the normal equations (None where they are singular), and the inverse of their matrix."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scaled = normal / np.outer(scale, scale)
    if np.linalg.eigvalsh(scaled)[0] < 1e-9:
        return None, np.zeros_like(normal)
    inverse = np.linalg.inv(scaled) / np.outer(scale, scale)
    return inverse @ right, inverse
