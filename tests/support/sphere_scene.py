"""Scans of spheres by casting rays, for tests and benchmarks: analytic, in numpy, sharing no code with `calib.targets`.

The scanner sits at the origin and looks along +z. A ball stands on a stem on a flange; behind it are a link, a wall and
a table. Noise is along the ray and grows with the incidence; pixels at jumps of depth lie between both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.scans.scan import Scan
from tests.support.scan_scene import (
    Cylinder,
    Patch,
    box,
    farthest_neighbours,
    jig_rotation,
    view_rays,
    with_strays,
)
from tests.support.smooth_fields import smooth_field

MIXED = 0.35  # share of the pixels at a jump of depth that lie between both sides


@dataclass(frozen=True)
class Ball:
    """A sphere."""

    centre: NDArray
    radius: float

    def hit(self, rays: NDArray) -> tuple[NDArray, NDArray]:
        """Distance along each ray (inf: missed) and |cos| of the incidence there. rays  # (R, 3) unit."""
        along = rays @ self.centre
        inside = self.radius**2 - (self.centre @ self.centre - along**2)
        with np.errstate(invalid="ignore"):
            half = np.sqrt(inside)
        return np.where(inside > 0, along - half, np.inf), half / self.radius


Piece = Ball | Patch | Cylinder


@dataclass(frozen=True)
class BallScan:
    """A scan of spheres with its truth."""

    scan: Scan
    balls: tuple[Ball, ...]
    label: NDArray  # (N,) which ball; -1: anything else
    known_mm2: NDArray  # (B, 3, 3) Cramer-Rao bound of each centre, its radius known
    free_mm2: NDArray  # (B, 3, 3) the same, its radius unknown

    def bound_mm(self, ball: int = 0, *, known: bool) -> float:
        """Cramer-Rao bound of the centre's 3D error, root mean square, mm."""
        covariance = (self.known_mm2 if known else self.free_mm2)[ball]
        return float(np.sqrt(np.trace(covariance)))


def flange(rng: np.random.Generator, at: NDArray, radius: float, *, stem: float = 0.35) -> list[Piece]:
    """A stem below a ball, its flange and a link, behind and below as seen from the scanner."""
    axis = np.array([rng.uniform(-0.5, 0.5), rng.uniform(0.2, 1.0), rng.uniform(0.4, 1.0)])
    axis /= np.linalg.norm(axis)
    side = np.cross(axis, [1.0, 0, 0])
    side /= np.linalg.norm(side)
    foot = at + 2.2 * radius * axis
    wide = max(2.0 * radius, 35.0)
    return [
        Cylinder(at, axis, stem * radius, 2.2 * radius),
        Patch(foot, wide * side, wide * np.cross(axis, side), "disk"),
        Cylinder(foot, axis, wide, 25.0),
        Cylinder(foot + 20 * axis, axis, 0.8 * wide, 300.0),
    ]


def surroundings(rng: np.random.Generator, distance: float) -> list[Piece]:
    """A wall behind, a table below, a box and a rod beside."""
    turn = jig_rotation(rng.uniform(0, 20), rng.uniform(0, 360), rng.uniform(0, 120))
    rod = rng.standard_normal(3)
    rod /= np.linalg.norm(rod)
    side = rng.choice([-1.0, 1.0])
    return [
        Patch(np.array([-600.0, -600, distance + 300]), np.array([1200.0, 0, 60]), np.array([0.0, 1200, 0])),
        Patch(np.array([-600.0, 95, distance - 300]), np.array([1200.0, 0, 0]), np.array([0.0, 30, 900])),
        *box(np.array([side * 75, rng.uniform(-30, 30), distance + 40]), turn, (40.0, 40.0, 40.0)),
        Cylinder(np.array([-side * 80, 0.0, distance]) - 60 * rod, rod, rng.uniform(6, 20), 120.0),
    ]


def cover(ball: Ball, share: float, rng: np.random.Generator) -> Patch:
    """A plate before a ball that hides that share of its silhouette's width, from one side."""
    angle = rng.uniform(0, 2 * np.pi)
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    along = np.array([-np.sin(angle), np.cos(angle), 0.0])
    near = ball.centre * (1 - 2.5 * ball.radius / np.linalg.norm(ball.centre))
    edge = near + across * ball.radius * (1 - 2 * share)
    return Patch(edge - 2 * ball.radius * along, 3 * ball.radius * across, 4 * ball.radius * along)


def scan_of(
    rng: np.random.Generator,
    balls: Sequence[Ball],
    others: Sequence[Piece],
    *,
    rays: int = 40_000,
    field_mm: float = 200.0,
    distance_mm: float = 700.0,
    sigma_mm: float = 0.02,
    stray: float = 0.0,
    smooth_mm: float = 0.0,
    smooth_length_mm: float = 15.0,
    smooth_kernel: str = "gaussian",
) -> BallScan:
    """A scan of balls; `stray` is the share of points that lie anywhere in the box of the balls' surroundings.

    `smooth_mm` adds an error along the ray that is smooth across the view (`smooth_fields.py`); the bounds do not know
    of it.
    """
    n = round(np.sqrt(rays))
    direction = view_rays(n, field_mm, distance_mm)
    hits = [piece.hit(direction) for piece in (*balls, *others)]
    depths = np.stack([h[0] for h in hits])
    label = np.argmin(depths, axis=0)
    t = depths[label, np.arange(n * n)]
    cosine = np.maximum(np.stack([h[1] for h in hits])[label, np.arange(n * n)], 1e-3)
    label[label >= len(balls)] = -1

    depth_there, neighbour = farthest_neighbours(t)
    jump = np.abs(neighbour - depth_there)
    pixel = field_mm / n
    mixed = (jump > 4 * pixel) & (jump < 2000) & (rng.random(n * n) < MIXED)
    share = rng.random(n * n)
    between = depth_there * (1 - share) + neighbour * share

    sigma_ray = sigma_mm * (0.5 + 0.5 / cosine**2)
    if smooth_mm > 0:
        t = t + smooth_mm * smooth_field(direction[:, :2] * distance_mm, smooth_length_mm, rng, smooth_kernel)
    with np.errstate(invalid="ignore"):
        noisy = np.where(mixed, between, t + sigma_ray * rng.standard_normal(n * n))
    keep = np.isfinite(noisy) & (rng.random(n * n) < np.clip(cosine / np.cos(np.radians(70)), 0, 1) ** 2)
    label = np.where(mixed, -1, label)
    points = (direction * noisy[:, None])[keep]
    true, seen = (direction * np.where(np.isfinite(t), t, 0.0)[:, None])[keep], label[keep]
    sigma_normal = (sigma_ray * cosine)[keep]
    bounds = [_bound(ball, true[seen == i], sigma_normal[seen == i]) for i, ball in enumerate(balls)]
    points, seen = with_strays(points, seen, stray, rng)
    order = rng.permutation(len(points))
    scan = Scan("balls", points[order].astype(np.float32).astype(np.float64))
    known, free = (np.array([bound[k] for bound in bounds]).reshape(-1, 3, 3) for k in range(2))
    return BallScan(scan, tuple(balls), seen[order], known, free)


def _bound(ball: Ball, points: NDArray, sigma: NDArray) -> tuple[NDArray, NDArray]:
    """Cramer-Rao bounds (3, 3) of a centre from points (K, 3) with noise along the normal: radius known, unknown."""
    if len(points) < 5:
        return np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    rows = np.c_[(points - ball.centre) / ball.radius, np.ones(len(points))] / sigma[:, None]
    information = rows.T @ rows
    return np.linalg.inv(information[:3, :3]), np.linalg.inv(information)[:3, :3]


def one_ball(
    rng: np.random.Generator,
    *,
    diameter_mm: float = 40.0,
    rays: int = 40_000,
    hidden: float = 0.0,
    stray: float = 0.0,
    sigma_mm: float = 0.02,
    absent: bool = False,
    field_mm: float = 200.0,
    smooth: tuple[float, float, str] = (0.0, 15.0, "gaussian"),
) -> BallScan:
    """A ball on a flange among wall, table, box and rod, some 700 mm away; `absent`: all but the ball."""
    ball = Ball(np.array([*rng.uniform(-15, 15, 2), 700 + rng.uniform(-20, 20)]), diameter_mm / 2)
    others = [*flange(rng, ball.centre, ball.radius), *surroundings(rng, 700.0)]
    if hidden > 0:
        others.append(cover(ball, hidden, rng))
    if absent:
        others = others[1:]  # without the stem too: its end would float
    smooth_mm, length_mm, kernel = smooth
    return scan_of(
        rng, [] if absent else [ball], others, rays=rays, stray=stray, sigma_mm=sigma_mm, field_mm=field_mm,
        smooth_mm=smooth_mm, smooth_length_mm=length_mm, smooth_kernel=kernel,
    )  # fmt: skip
