"""Four kinds of scanner that look at a triangle mesh by casting rays (Embree through Open3D).

Embree says which triangle a ray meets; where it meets it is computed anew in double precision. The view frame has the
eye at the origin, looks along +z, and y points down.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from tests.support.mesh_parts import Mesh

TAILS = 5.0  # degrees of freedom of Student's t, scaled to the sigma that is asked for
MIXED = -1  # label of points that are no surface's: mixed, averaged over an edge


@dataclass(frozen=True)
class Scanner:
    """Optics, noise and sampling of a scanner; lengths in mm."""

    kind: str = "structured light"  # "laser lines", "time of flight", "fused mesh"
    points: int = 60_000  # wanted, of the whole scan
    distance: float = 700.0
    field: float = 200.0  # width of the view at the jig
    sigma: float = 0.02  # along the ray at `distance`, seen squarely
    quantum: float = 0.01  # steps of the depth
    heavy_tails: bool = True
    baseline: float = 180.0  # from eye to projector, or from laser to camera
    line_step: float = 0.7
    origin_away: float = 0.0  # the points' origin lies so far from the eye
    registration: float = 0.0  # of each view of a fused mesh
    patches: int = 6  # at most so many round places without depth, in structured light and laser lines
    no_depth: str = "left out"  # or "nan", "zero"


@dataclass(frozen=True)
class Seen:
    """A scan in the view frame, and what is known of its points (of a fused mesh: of those it was made of)."""

    points_mm: NDArray  # (N, 3)
    label: NDArray  # (N,)
    true_mm: NDArray  # (M, 3) where the surfaces are
    true_label: NDArray  # (M,)
    normal_sigma_mm: NDArray  # (M,) along the surface's normal


class Rays:
    """A mesh that answers rays."""

    def __init__(self, mesh: Mesh) -> None:
        import open3d

        self.scene = open3d.t.geometry.RaycastingScene(nthreads=1)
        self.tensor = open3d.core.Tensor.from_numpy
        self.scene.add_triangles(
            self.tensor(mesh.vertices_mm.astype(np.float32)), self.tensor(mesh.triangles.astype(np.uint32))
        )
        corner = mesh.vertices_mm[mesh.triangles]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        self.normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        self.height = np.einsum("ti,ti->t", self.normal, corner[:, 0])
        self.label = np.r_[mesh.label, MIXED]

    def cast(self, origins: NDArray, ways: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Multiples of `ways` (R, 3) until a surface (inf: none), |cos| of the incidence there, and its label."""
        rays = np.hstack([np.broadcast_to(origins, ways.shape), ways]).astype(np.float32)
        triangle = self.scene.cast_rays(self.tensor(rays), nthreads=1)["primitive_ids"].numpy()
        hit = triangle < len(self.normal)
        number = np.where(hit, triangle, 0).astype(int)
        along = np.einsum("ri,ri->r", self.normal[number], ways)
        start = np.einsum("ri,ri->r", self.normal[number], np.broadcast_to(origins, ways.shape))
        with np.errstate(divide="ignore", invalid="ignore"):
            times = np.where(hit, (self.height[number] - start) / along, np.inf)
        cosine = np.abs(along) / np.linalg.norm(ways, axis=1)
        return times, cosine, np.where(hit, self.label[number], MIXED)

    def open_between(self, points: NDArray, eye: NDArray) -> NDArray:
        """Whether each point (N, 3) is seen from another place."""
        way = eye - points
        start = points + way * (0.05 / np.linalg.norm(way, axis=1, keepdims=True))
        rays = np.hstack([start, eye - start]).astype(np.float32)
        return ~self.scene.test_occlusions(self.tensor(rays), tnear=0.0, tfar=0.9999, nthreads=1).numpy()


def _noise(rng: np.random.Generator, count: int, heavy: bool) -> NDArray:
    return rng.standard_t(TAILS, count) * np.sqrt((TAILS - 2) / TAILS) if heavy else rng.standard_normal(count)


def _camera(rays: Rays, scanner: Scanner, rng: np.random.Generator, points: int, blur: float, growth: float
            ) -> tuple[Seen, NDArray]:  # fmt: skip
    """A depth camera at the origin: blurred over 3 x 3 pixels, noisy, in steps of the depth.

    1 / depth is linear in the image of a plane, so blurring it bends no plane but at its edges. Returns the points and
    the largest jump of depth beside each.
    """
    wide = round(np.sqrt(points * 4 / 3))
    high = round(wide * 3 / 4)
    pixel = scanner.field / scanner.distance / wide
    x, y = np.meshgrid((np.arange(wide) - wide / 2) * pixel, (np.arange(high) - high / 2) * pixel)
    ways = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    depth, cosine, label = rays.cast(np.zeros(3), ways)
    inverse = np.pad((1 / depth).reshape(high, wide), 1, mode="edge")
    mixed, weight, largest, least = (
        np.zeros((high, wide)),
        np.zeros((high, wide)),
        inverse[1:-1, 1:-1],
        inverse[1:-1, 1:-1],
    )
    for i in range(3):
        for j in range(3):
            value = inverse[i : i + high, j : j + wide]
            share = blur ** ((i - 1) ** 2 + (j - 1) ** 2)
            mixed, weight = mixed + share * value, weight + share
            largest, least = np.maximum(largest, value), np.minimum(least, value)
    hit = np.isfinite(depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        blurred = (weight / mixed).ravel()
        jump = (1 / least - 1 / largest).ravel()
    sigma = scanner.sigma * (np.where(hit, depth, 1) / scanner.distance) ** 2
    sigma *= 0.5 + 0.5 / np.maximum(cosine, 0.05) ** growth
    noisy = np.where(hit, blurred, 1) + sigma * _noise(rng, len(depth), scanner.heavy_tails)
    if scanner.quantum:
        noisy = np.round(noisy / scanner.quantum) * scanner.quantum
    label = np.where(jump > 4 * scanner.field / wide / np.maximum(cosine, 0.05), MIXED, label)
    hit &= noisy > 0.1 * scanner.distance
    along_normal = np.hypot(sigma, scanner.quantum / np.sqrt(12)) * np.linalg.norm(ways, axis=1) * cosine
    true = (ways * np.where(hit, depth, 1)[:, None])[hit]
    return Seen((ways * noisy[:, None])[hit], label[hit], true, label[hit], along_normal[hit]), jump[hit]


def _kept(seen: Seen, keep: NDArray) -> Seen:
    label = seen.label[keep]
    return Seen(seen.points_mm[keep], label, seen.true_mm[keep], label, seen.normal_sigma_mm[keep])


def _without_patches(seen: Seen, scanner: Scanner, rng: np.random.Generator) -> NDArray:
    """(N,) false in a few round places where the light was reflected away."""
    keep = np.ones(len(seen.label), dtype=bool)
    for _ in range(rng.integers(scanner.patches + 1) if len(keep) else 0):
        place = seen.true_mm[rng.integers(len(keep))]
        keep &= np.linalg.norm(seen.true_mm - place, axis=1) > rng.uniform(0.01, 0.04) * scanner.field
    return keep


def structured_light(rays: Rays, scanner: Scanner, apex: NDArray, rng: np.random.Generator) -> Seen:
    """Eye at the origin, projector to its right: what the projector does not reach has no depth."""
    seen, jump = _camera(rays, scanner, rng, round(1.4 * scanner.points), blur=0.15, growth=1.5)
    keep = rays.open_between(seen.true_mm, np.array([scanner.baseline, 0.0, 0.0]))
    keep &= (jump < 0.03 * scanner.field) | (rng.random(len(jump)) < 0.15)
    keep &= _without_patches(seen, scanner, rng)
    return _kept(seen, keep)


def time_of_flight(rays: Rays, scanner: Scanner, apex: NDArray, rng: np.random.Generator) -> Seen:
    """Every pixel answers, and averages over its neighbours."""
    return _camera(rays, scanner, rng, round(1.1 * scanner.points), blur=0.5, growth=0.7)[0]


def laser_lines(rays: Rays, scanner: Scanner, apex: NDArray, rng: np.random.Generator) -> Seen:
    """A laser line, seen by a camera behind it, moved along y: dense along the line, wide steps from line to line."""
    steps = np.arange(-0.5, 0.5, scanner.line_step / scanner.field) * scanner.field
    steps = steps + 0.01 * rng.standard_normal(len(steps))
    across = max(round(1.4 * scanner.points / len(steps)), 20)
    x = np.linspace(-0.5, 0.5, across) * scanner.field / scanner.distance
    ways = np.tile(np.column_stack([x, np.zeros(across), np.ones(across)]), (len(steps), 1))
    eyes = np.repeat(np.column_stack([0 * steps, steps, 0 * steps]), across, axis=0)
    depth, cosine, label = rays.cast(eyes, ways)
    hit = np.isfinite(depth)
    depth = np.where(hit, depth, 1)
    sigma = scanner.sigma * (0.7 + 0.3 / np.maximum(cosine, 0.05))
    noisy = depth + sigma * _noise(rng, len(depth), scanner.heavy_tails)
    if scanner.quantum:
        noisy = np.round(noisy / scanner.quantum) * scanner.quantum
    along_normal = np.hypot(sigma, scanner.quantum / np.sqrt(12)) * np.linalg.norm(ways, axis=1) * cosine
    true = eyes + ways * depth[:, None]
    seen = _kept(Seen(eyes + ways * noisy[:, None], label, true, label, along_normal), hit)
    keep = rays.open_between(seen.true_mm, eyes[hit] + [0, scanner.baseline, 0])
    return _kept(seen, keep & _without_patches(seen, scanner, rng))


def fused_mesh(rays: Rays, scanner: Scanner, apex: NDArray, rng: np.random.Generator) -> Seen:
    """Several views averaged in small cells and smoothed, as vertices in no order. The bound is that of the views."""
    views = []
    for number in range(4):
        way = rng.normal(0, 0.35, 2) * scanner.distance * (number > 0)
        eye = np.array([*way, 0.0])
        turn = Rotation.align_vectors([apex - eye], [[0, 0, 1.0]])[0].as_matrix()
        views.append(_view_from(rays, scanner, eye, turn, rng))
    cell = scanner.field / np.sqrt(scanner.points)
    points, label = (np.concatenate([getattr(v, name) for v in views]) for name in ("points_mm", "label"))
    _, of_cell, count = np.unique(np.floor(points / cell).astype(int), axis=0, return_inverse=True, return_counts=True)
    of_cell = of_cell.ravel()
    vertices = np.column_stack([np.bincount(of_cell, column) / count for column in points.T])
    names = np.full(len(count), MIXED)
    names[of_cell] = label
    names[np.unique(of_cell[names[of_cell] != label])] = MIXED
    near = np.asarray(cKDTree(vertices).query(vertices, k=7)[1])
    smooth = 0.4 * vertices + 0.6 * vertices[near].mean(axis=1)
    names = np.where(np.all(names[near] == names[:, None], axis=1), names, MIXED)
    smooth, names = smooth[(order := rng.permutation(len(smooth)))], names[order]
    true, of, sigma = (np.concatenate([getattr(v, n) for v in views]) for n in ("true_mm", "label", "normal_sigma_mm"))
    return Seen(smooth, names, true, of, sigma)


def _view_from(rays: Rays, scanner: Scanner, eye: NDArray, turn: NDArray, rng: np.random.Generator) -> Seen:
    """View of a fused mesh from a camera anywhere, a little off where it is thought to be."""
    wide = round(np.sqrt(1.2 * scanner.points))
    line = (np.arange(wide) / wide - 0.5) * scanner.field / scanner.distance
    x, y = np.meshgrid(line, line)
    ways = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)]) @ turn.T
    depth, cosine, label = rays.cast(eye, ways)
    hit = np.isfinite(depth) & (rng.random(len(depth)) < np.minimum(1, cosine / 0.35))
    depth, cosine, label, ways = depth[hit], cosine[hit], label[hit], ways[hit]
    sigma = scanner.sigma * (0.5 + 0.5 / np.maximum(cosine, 0.05))
    noisy = depth + sigma * _noise(rng, len(depth), scanner.heavy_tails)
    off = scanner.registration * rng.standard_normal(3)
    along_normal = sigma * np.linalg.norm(ways, axis=1) * cosine
    true = eye + ways * depth[:, None]
    return Seen(eye + ways * noisy[:, None] + off, label, true, label, along_normal)


SCANNERS: dict[str, Callable[[Rays, Scanner, NDArray, np.random.Generator], Seen]] = {
    "structured light": structured_light,
    "laser lines": laser_lines,
    "time of flight": time_of_flight,
    "fused mesh": fused_mesh,
}
