"""Balls before the second scanner simulator: a fine mesh of a sphere, blurred and quantised pixels, heavy tails.

It shares no code with `sphere_scene`: rays into triangles (Embree), kinds of scanner that blur and round their points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.scans.scan import Scan
from tests.support.mesh_parts import Mesh, box, joined, rod, transform, workshop
from tests.support.mesh_scanners import SCANNERS, TAILS, Rays, Scanner
from tests.support.sphere_scene import Ball, BallScan

BALL = 0


def ball_mesh(ball: Ball) -> Mesh:
    """81,920 triangles, as large as the sphere on average: flat facets lie inside of one through their corners."""
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=6, radius=ball.radius)
    middles = np.linalg.norm(np.asarray(made.triangles_center), axis=1).mean()
    inward = (ball.radius - middles) / 2
    vertices = np.asarray(made.vertices) * (1 + inward / ball.radius) + ball.centre
    return Mesh(vertices, np.asarray(made.faces), np.full(len(made.faces), BALL))


def scan_of_ball(rng: np.random.Generator, scanner: Scanner, diameter_mm: float, *, absent: bool = False) -> BallScan:
    """A ball on a stem on a plate, in a workshop. The bound is of the points' true places and sigmas."""
    radius = diameter_mm / 2
    ball = Ball(np.array([*rng.uniform(-0.3, 0.3, 2) * radius, scanner.distance]), radius)
    axis = np.array([rng.uniform(-0.6, 0.6), rng.uniform(0.2, 1.0), rng.uniform(0.3, 1.0)])
    axis /= np.linalg.norm(axis)
    foot = ball.centre + 2.5 * radius * axis
    side = np.linalg.svd(axis[None])[2][1:]
    plate = box((4 * radius, 4 * radius, 0.4 * radius)).moved(transform(np.c_[side.T, axis], foot))
    parts = [plate, rod(ball.centre + 0.97 * radius * axis, foot, 0.3 * radius)]
    parts += workshop(ball.centre, diameter_mm, rng)
    if absent:
        parts = parts[:1] + parts[2:]
    else:
        parts.append(ball_mesh(ball))
    seen = SCANNERS[scanner.kind](Rays(joined(parts)), scanner, ball.centre, rng)
    on = seen.true_label == BALL
    more = TAILS * (TAILS + 1) / ((TAILS - 2) * (TAILS + 3)) if scanner.heavy_tails else 1.0
    known, free = _bounds(seen.true_mm[on], seen.normal_sigma_mm[on], ball, more)
    label = np.where(seen.label == BALL, 0, -1)
    return BallScan(Scan(scanner.kind, seen.points_mm), (ball,), label, known[None], free[None])


def _bounds(points: NDArray, sigma: NDArray, ball: Ball, more: float) -> tuple[NDArray, NDArray]:
    if len(points) < 6:
        return np.full((3, 3), np.nan), np.full((3, 3), np.nan)
    way = points - ball.centre
    rows = np.c_[way / np.linalg.norm(way, axis=1)[:, None], np.ones(len(way))]
    information = more * (rows / sigma[:, None] ** 2).T @ rows
    return np.linalg.inv(information[:3, :3]), np.linalg.inv(information)[:3, :3]


def plain_scanner(kind: str, rng: np.random.Generator, points: int, diameter_mm: float) -> Scanner:
    """A scanner with the ball well in view, its origin at its eye."""
    away = float(rng.uniform(500, 900))
    common = Scanner(kind, points=points, distance=away, field=max(5 * diameter_mm, 150.0), sigma=0.03)
    if kind == "laser lines":
        return replace(common, line_step=common.field / np.sqrt(points), baseline=0.25 * away)
    if kind == "time of flight":
        return replace(common, sigma=0.3, quantum=0.05)
    return common
