"""A small ray caster for tests and benchmarks: analytic ray-patch and ray-cylinder intersections in numpy.

It shares no code with the product's own simulator, so that the two check each other. The scanner sits at the origin and
looks along +z. The jig is the corner of a cube of edge `edge_mm`, cut off along the diagonal, on a round flange.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.scans.scan import Scan
from tests.support.smooth_fields import correlation, smooth_field

FACE_LABELS = (0, 1, 2)
FLYING = 0.35  # share of the pixels at a jump in depth that lie between both sides


@dataclass(frozen=True)
class Patch:
    """A flat piece: origin + a u + b v with 0 <= a, b (<= 1), for a triangle a + b <= 1, for a disk a^2 + b^2 <= 1."""

    origin: NDArray
    u: NDArray
    v: NDArray
    shape: str = "parallelogram"

    def hit(self, rays: NDArray) -> tuple[NDArray, NDArray]:
        """Distance along each ray (inf: missed) and |cos| of the incidence there. rays  # (R, 3) unit."""
        normal = np.cross(self.u, self.v)
        along = rays @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (self.origin @ normal) / along
            p = rays * t[:, None] - self.origin
            gram = np.array([[self.u @ self.u, self.u @ self.v], [self.u @ self.v, self.v @ self.v]])
            a, b = np.linalg.solve(gram, np.stack([p @ self.u, p @ self.v]))
            if self.shape == "disk":
                inside = a * a + b * b <= 1
            else:
                inside = (a >= 0) & (b >= 0) & ((a + b <= 1) if self.shape == "triangle" else (a <= 1) & (b <= 1))
        return np.where(inside & (t > 0), t, np.inf), np.abs(along) / np.linalg.norm(normal)


@dataclass(frozen=True)
class BowedFace(Patch):
    """A piece of the sphere through the face's apex and the other ends of its two edges.

    It rises by `bow_mm` over the middle of the line between these ends, toward the scanner, or sinks below it.
    """

    bow_mm: float = 0.0

    def hit(self, rays: NDArray) -> tuple[NDArray, NDArray]:
        normal = np.cross(self.u, self.v)
        normal *= -np.sign(normal @ self.origin) / np.linalg.norm(normal)
        middle = self.origin + 0.5 * (self.u + self.v)  # of the circle through the three corners of a right triangle
        square = 0.25 * float((self.u - self.v) @ (self.u - self.v))
        centre = middle + 0.5 * (self.bow_mm - square / self.bow_mm) * normal
        radius = 0.5 * (abs(self.bow_mm) + square / abs(self.bow_mm))
        along = rays @ centre
        with np.errstate(invalid="ignore"):
            root = np.sqrt(along**2 - centre @ centre + radius**2)
        t = along - np.sign(self.bow_mm) * root
        p = rays * t[:, None] - self.origin
        a, b = np.linalg.lstsq(np.stack([self.u, self.v]).T, p.T, rcond=None)[0]
        inside = (a >= 0) & (b >= 0) & ((a + b <= 1) if self.shape == "triangle" else (a <= 1) & (b <= 1))
        cosine = np.abs(np.sum((rays * t[:, None] - centre) * rays, axis=1)) / radius
        return np.where(inside & (t > 0), t, np.inf), cosine


@dataclass(frozen=True)
class Cylinder:
    """A cylinder's side from `base` along the unit `axis`, `length` long."""

    base: NDArray
    axis: NDArray
    radius: float
    length: float

    def hit(self, rays: NDArray) -> tuple[NDArray, NDArray]:
        d = rays - (rays @ self.axis)[:, None] * self.axis
        o = -self.base + (self.base @ self.axis) * self.axis
        a, b, c = np.sum(d * d, axis=1), d @ o, o @ o - self.radius**2
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-b - np.sqrt(b * b - a * c)) / a
            along = t * (rays @ self.axis) - self.base @ self.axis
            normal = (t[:, None] * d + o) / self.radius
        ok = np.isfinite(t) & (t > 0) & (along >= 0) & (along <= self.length)
        return np.where(ok, t, np.inf), np.abs(np.sum(normal * rays, axis=1))


def box(corner: NDArray, rotation: NDArray, size: tuple[float, float, float]) -> list[Patch]:
    """The six sides of a box with one corner at `corner` and edges along the columns of `rotation`."""
    e = [rotation[:, i] * size[i] for i in range(3)]
    sides = []
    for i in range(3):
        u, v = e[(i + 1) % 3], e[(i + 2) % 3]
        sides += [Patch(corner, u, v), Patch(corner + e[i], u, v)]
    return sides


@dataclass(frozen=True)
class SceneScan:
    """A scan of the ray caster with its truth."""

    scan: Scan
    label: NDArray  # (N,) 0, 1, 2 the jig's faces; above: the rest; -1 flying pixels and outliers
    apex_mm: NDArray  # (3,)
    normals: NDArray  # (3, 3) rows: the faces' outward normals
    bound_mm: float  # Cramer-Rao bound of the apex's RMS error (3D), three free planes


def jig_rotation(tilt_deg: float, azimuth_deg: float, spin_deg: float) -> NDArray:
    """Columns: the jig's three edges from the apex. The diagonal points away from the scanner, tilted off its axis."""
    edges = Rotation.align_vectors([[0, 0, 1]], [[1, 1, 1]])[0].as_matrix()
    spin = Rotation.from_euler("z", spin_deg, degrees=True).as_matrix()
    azimuth = np.radians(azimuth_deg)
    tilt = Rotation.from_rotvec(np.radians(tilt_deg) * np.array([np.cos(azimuth), np.sin(azimuth), 0])).as_matrix()
    return tilt @ spin @ edges


def grazing(rng: np.random.Generator, incidence_deg: float) -> NDArray:
    """Orientation of a jig whose third face is seen at that angle off its normal."""
    edges = jig_rotation(0, 0, rng.uniform(0, 360))
    normal = -edges[:, 2]
    axis = np.cross(normal, [0, 0, -1.0])
    by = np.arccos(-normal[2]) - np.radians(incidence_deg)
    return Rotation.from_rotvec(by * axis / np.linalg.norm(axis)).as_matrix() @ edges


def room(rng: np.random.Generator) -> tuple[Patch, ...]:
    """Three perpendicular walls that meet 300 mm behind the jig."""
    walls = -900 * jig_rotation(rng.uniform(0, 20), rng.uniform(0, 360), rng.uniform(0, 120)).T
    corner = np.array([20.0, -10.0, 1000.0])
    return tuple(Patch(corner, walls[i], walls[(i + 1) % 3]) for i in range(3))


def box_beside(rng: np.random.Generator, size: float) -> tuple[Patch, ...]:
    """A box whose corner looks at the scanner, to the left of the jig."""
    turn = jig_rotation(rng.uniform(0, 20), rng.uniform(0, 360), rng.uniform(0, 120))
    left = -43.0 - 0.8 * size  # clear of the jig
    return tuple(box(np.array([left, rng.uniform(-20, 20), 690.0]), turn, (size, size, size)))


def cylinder_beside(rng: np.random.Generator) -> Cylinder:
    """A cylinder of any direction and 16 to 50 mm across, to the left or right of the jig."""
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    middle = np.array([rng.choice([-1, 1]) * rng.uniform(55, 75), rng.uniform(-30, 30), 700.0])
    return Cylinder(middle - 60 * axis, axis, rng.uniform(8, 25), 120.0)


def parallel_planes(rng: np.random.Generator, rays: int) -> SceneScan:
    """A jig with a plate parallel to each of its faces, some millimetres before or behind and off to the side."""
    rotation = jig_rotation(rng.uniform(0, 22), rng.uniform(0, 360), rng.uniform(0, 120))
    plates = []
    for i in range(3):
        u, v = rotation[:, (i + 1) % 3], rotation[:, (i + 2) % 3]
        height = rng.choice([-1, 1]) * rng.uniform(5, 25)
        origin = np.array([0, 0, 700.0]) - height * rotation[:, i] + rng.uniform(40, 70) * (u + v)
        plates.append(Patch(origin, rng.uniform(20, 70) * u, rng.uniform(20, 70) * v))
    return make_scene(rng, rays, field_mm=220, rotation=rotation, extras=tuple(plates))


def make_scene(
    rng: np.random.Generator,
    rays: int = 12_000,
    *,
    edge_mm: float = 60.0,
    edges_mm: tuple[float, float, float] | None = None,
    rectangular: bool = False,
    distance_mm: float = 700.0,
    field_mm: float = 160.0,
    sigma_mm: float = 0.02,
    rotation: NDArray | None = None,
    convex: bool = True,
    extras: tuple[Patch | Cylinder, ...] = (),
    background: bool = True,
    outliers: float = 0.0,
    flying: float = FLYING,
    cut_face: float = 1.0,
    fillet_mm: float = 0.0,
    waves_mm: float = 0.0,
    wave_length_mm: float = 15.0,
    wave_kernel: str = "gaussian",
    uneven_mm: float = 0.0,
    wall_bent_mm: float = 0.0,
    bows_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> SceneScan:
    """A scan of a jig some `distance_mm` away among flange, link, wall and table.

    `edges_mm` makes its three edges differ, about `edge_mm` on average; `rectangular` gives it a box's whole faces.
    `outliers` is the share of points thrown anywhere into the scene's volume, `flying` that of the pixels at a jump in
    depth that lie between both sides (`stray_points.py` has further strays); `cut_face` keeps that share of the
    third face's area (a strip along one edge); `extras` are further patches in the scanner's frame; `fillet_mm` is the
    radius that rounds the jig's three edges and its apex. `waves_mm` adds an error along the ray that is smooth over
    `wave_length_mm` across the view, of the correlation `wave_kernel` (`smooth_fields.py`); `uneven_mm` is the same of
    each of the jig's faces by itself, along its normal; the wall bulges by `wall_bent_mm` over the view, and `bows_mm`
    are the bows of the faces (`BowedFace`). The bound does not know of them.
    """
    if rotation is None:
        rotation = jig_rotation(rng.uniform(0, 22), rng.uniform(0, 360), rng.uniform(0, 120))
    apex = np.array([rng.uniform(-20, 20), rng.uniform(-20, 20), rng.uniform(-20, 20) + distance_mm])
    edges = rotation * (edges_mm or edge_mm)
    diagonal = rotation.sum(axis=1) / np.sqrt(3)
    directions = rotation if convex else -rotation
    if not convex:  # the inside of a box: the edges come toward the scanner
        apex = apex + diagonal * edge_mm / np.sqrt(3)
        edges = -edges
    pieces: list[Patch | Cylinder] = []
    for i in range(3):
        u, v = edges[:, (i + 1) % 3], edges[:, (i + 2) % 3]
        shape = "parallelogram" if rectangular else "triangle"
        v = v * cut_face if i == 2 else v
        pieces.append(BowedFace(apex, u, v, shape, bows_mm[i]) if bows_mm[i] else Patch(apex, u, v, shape))
    normals = -np.linalg.inv(directions) if convex else np.linalg.inv(directions)
    if background:
        depth = 3 * edge_mm if rectangular else edge_mm
        behind = apex + diagonal * (depth / np.sqrt(3) + 5 if convex else 5)
        side = np.cross(diagonal, [1.0, 0, 0])
        side /= np.linalg.norm(side)
        other = np.cross(diagonal, side)
        pieces.append(Patch(behind, 0.75 * edge_mm * side, 0.75 * edge_mm * other, "disk"))
        pieces.append(Cylinder(behind, diagonal, 0.75 * edge_mm, 25.0))
        axis = diagonal + 0.8 * side
        axis /= np.linalg.norm(axis)
        pieces.append(Cylinder(behind + 20 * diagonal, axis, 0.6 * edge_mm, 300.0))
        pieces.append(
            Patch(
                np.array([-600.0, -600, distance_mm + 300]),
                np.array([1200.0, 0, 60]),
                np.array([0.0, 1200, 0]),
            )
        )
        pieces.append(
            Patch(
                np.array([-600.0, 1.25 * edge_mm, distance_mm - 300]),
                np.array([1200.0, 0, 0]),
                np.array([0.0, 30, 900]),
            )
        )
    pieces += list(extras)

    n = round(np.sqrt(rays))
    direction = view_rays(n, field_mm, distance_mm)
    hits = [piece.hit(direction) for piece in pieces]
    depth = np.stack([h[0] for h in hits])
    label = np.argmin(depth, axis=0)
    t = depth[label, np.arange(n * n)]
    cosine = np.stack([h[1] for h in hits])[label, np.arange(n * n)]

    if fillet_mm > 0:
        on = np.flatnonzero((label < 3) & np.isfinite(t))
        t[on], cosine[on], flat = _rounded(direction[on], t[on], apex, normals, fillet_mm, convex)
        label[on[~flat]] = 3

    depth_there, neighbour = farthest_neighbours(t)
    jump = np.abs(neighbour - depth_there)
    fly = (jump > 12) & (jump < 2000) & (rng.random(n * n) < flying)
    share = rng.random(n * n)
    t_flying = depth_there * (1 - share) + neighbour * share

    with np.errstate(invalid="ignore", divide="ignore"):
        sigma_ray = sigma_mm * (0.5 + 0.5 / cosine**2)
        noisy = t + sigma_ray * rng.standard_normal(n * n)
    if waves_mm > 0:
        across = direction[:, :2] / direction[:, 2:] * apex[2]
        noisy += waves_mm * smooth_field(across, wave_length_mm, rng, wave_kernel)
    if uneven_mm > 0:
        for i in range(3):
            on = np.flatnonzero(label == i)
            over = (direction[on] * t[on, None] - apex) @ rotation[:, [(i + 1) % 3, (i + 2) % 3]]
            noisy[on] += uneven_mm * smooth_field(over, wave_length_mm, rng, wave_kernel) / cosine[on]
    if wall_bent_mm > 0:
        noisy += np.where(label == 6, wall_bent_mm * (2 * direction[:, 0] * distance_mm / field_mm) ** 2, 0.0)
    keep = np.isfinite(t) & (rng.random(n * n) < np.clip(cosine / np.cos(np.radians(70)), 0, 1) ** 2)
    noisy = np.where(fly, t_flying, noisy)
    label = np.where(fly, -1, label)
    points = (direction * noisy[:, None])[keep]
    label, sigma_normal = label[keep], (sigma_ray * cosine)[keep]
    truth = (direction * t[:, None])[keep]

    heights = np.zeros(3)  # variance of each plane's height at the apex
    for i in range(3):
        on = label == i
        design = np.c_[np.ones(on.sum()), (truth[on] - apex) @ rotation[:, [(i + 1) % 3, (i + 2) % 3]]]
        heights[i] = np.linalg.inv(design.T @ (design / sigma_normal[on, None] ** 2))[0, 0] if on.sum() > 3 else np.inf
    inverse = np.linalg.inv(normals)
    covariance = inverse @ np.diag(heights) @ inverse.T

    points, label = with_strays(points, label, outliers, rng)
    order = rng.permutation(len(points))
    scan = Scan("scene", points[order].astype(np.float32).astype(np.float64))
    return SceneScan(scan, label[order], apex, normals, float(np.sqrt(np.trace(covariance))))


def view_rays(n: int, field_mm: float, distance_mm: float) -> NDArray:
    """Unit rays (n * n, 3) of a square view, so wide at that distance."""
    grid = ((np.arange(n) + 0.5) / n - 0.5) * field_mm / distance_mm
    x, y = np.meshgrid(grid, grid, indexing="xy")
    direction = np.stack([x.ravel(), y.ravel(), np.ones(n * n)], axis=1)
    return np.asarray(direction / np.linalg.norm(direction, axis=1, keepdims=True))


def farthest_neighbours(t: NDArray) -> tuple[NDArray, NDArray]:
    """Depths (n * n,) of a square view, 5 m where nothing is met, and of each pixel's neighbour that differs most."""
    n = round(np.sqrt(len(t)))
    image = np.where(np.isfinite(t), t, 5000.0).reshape(n, n)
    other = image.copy()
    for axis, shift in ((0, 1), (1, 1), (0, -1), (1, -1)):
        rolled = np.roll(image, shift, axis=axis)
        other = np.where(np.abs(rolled - image) > np.abs(other - image), rolled, other)
    return image.ravel(), other.ravel()


def with_strays(points: NDArray, label: NDArray, share: float, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """The points with so large a share of others, labelled -1, anywhere in the box around them."""
    if share == 0:
        return points, label
    count = round(len(points) * share / (1 - share))
    low, high = points.min(axis=0), points.max(axis=0)
    return np.vstack([points, rng.uniform(low, high, (count, 3))]), np.r_[label, np.full(count, -1)]


def smooth_bound_mm(made: SceneScan, sigma_mm: float, waves_mm: float, length_mm: float, kernel: str) -> float:
    """Cramer-Rao bound of the apex's RMS error where a smooth error of known kernel is added to the white noise.

    It takes every point of the three faces, at most 2000 of them with as much less white noise.
    """
    on = np.flatnonzero((made.label >= 0) & (made.label < 3))
    some = on[:: max(1, len(on) // 2000)]
    points, face = made.scan.points_mm[some], made.label[some]
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    cosine = np.abs(np.sum(rays * made.normals[face], axis=1))
    across = points[:, :2] / points[:, 2:] * made.apex_mm[2]
    apart = np.linalg.norm(across[:, None] - across, axis=2)
    covariance = waves_mm**2 * correlation(apart, length_mm, kernel) * np.outer(cosine, cosine)
    white_mm2 = (sigma_mm * (0.5 + 0.5 / cosine**2) * cosine) ** 2 * len(some) / len(on)
    design = np.zeros((len(some), 9))
    for i in range(3):
        own = face == i
        along = np.linalg.svd(made.normals[i][None])[2][1:]
        design[own, 3 * i : 3 * i + 3] = np.c_[np.ones(own.sum()), (points[own] - made.apex_mm) @ along.T]
    planes = np.linalg.inv(design.T @ np.linalg.solve(covariance + np.diag(white_mm2), design))
    inverse = np.linalg.inv(made.normals)
    return float(np.sqrt(np.trace(inverse @ planes[::3, ::3] @ inverse.T)))


def _rounded(
    rays: NDArray, t: NDArray, apex: NDArray, normals: NDArray, radius: float, convex: bool
) -> tuple[NDArray, NDArray, NDArray]:
    """Distance, |cos| of incidence and whether the ray meets a flat part, on a corner with rounded edges.

    The signed distance to three rounded half-spaces is |max(h + r, 0)| - r, h the heights over the faces (the inside of
    a box has the opposite sign); the rays walk along it from before the sharp corner (R, 3).
    """
    sign = 1.0 if convex else -1.0
    t = t - 4 * radius
    for _ in range(80):
        raised = np.maximum(sign * (rays * t[:, None] - apex) @ normals.T + radius, 0)
        length = np.linalg.norm(raised, axis=1)
        t = t + sign * (length - radius)
    gradient = raised @ normals / np.maximum(length, 1e-12)[:, None]
    t = np.where(np.abs(length - radius) < 1e-6, t, np.inf)  # past the silhouette that the rounding takes away
    return t, np.abs(np.sum(gradient * rays, axis=1)), np.sum(raised > 1e-9, axis=1) == 1
