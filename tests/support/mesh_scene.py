"""A second scanner simulator for tests and benchmarks: rays cast into triangle meshes (Embree through Open3D).

It shares no code and few habits with tests/scan_scene.py: other jigs (chamfers, holes, stickers, base plates), other
surroundings, any attitude, and four kinds of scanner that see, blur, round and order their points each in its own way.
Embree says which triangle a ray meets; where it meets it is computed anew in double precision.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.scans.scan import Scan
from tests.support.mesh_parts import (
    JigShape,
    Mesh,
    box,
    bracket,
    cable,
    jig_mesh,
    joined,
    robot_behind,
    rod,
    transform,
    workshop,
)
from tests.support.mesh_scanners import MIXED, SCANNERS, TAILS, Rays, Scanner, Seen


@dataclass(frozen=True)
class Scene:
    """Everything to be seen besides the jig's shape."""

    jig: str = "in view"  # "absent", "turned away", "in shadow", "covered", "cube instead"
    bracket: bool = False
    cable: bool = False
    workshop: bool = True
    steepest_deg: float | None = None  # the largest incidence, where it is asked for; the others are below 70


@dataclass(frozen=True)
class MeshScan:
    """A scan of meshes with its truth."""

    scan: Scan
    label: NDArray  # (N,) 0, 1, 2 the jig's faces; 3 its rest; 4 all else; -1 mixed
    apex_mm: NDArray  # (3,) where the three faces' planes meet
    covariance_mm2: NDArray  # (3, 3) Cramer-Rao bound of the apex, three free planes
    has_jig: bool  # three faces of a jig have points: without them no corner is right
    seen: NDArray  # (3,) share of each face that the rest of the scene leaves in view
    incidence_deg: NDArray  # (3,)
    edge_mm: float

    @property
    def bound_mm(self) -> float:
        return float(np.sqrt(np.trace(self.covariance_mm2)))

    @property
    def points_a_face(self) -> NDArray:
        return np.bincount(self.label[self.label >= 0], minlength=5)[:3]

    @property
    def fair(self) -> bool:
        """Whether a person would ask for a corner: 40 points on each face, and a third of each in view."""
        return bool(self.has_jig and self.points_a_face.min() >= 40 and self.seen.min() > 1 / 3)


def attitude(apex: NDArray, edge: float, rng: np.random.Generator, scene: Scene, other_eye: NDArray) -> NDArray:
    """Any rotation (3, 3) that shows three faces below 80 degrees to the eye at the origin, or one at `steepest_deg`.

    Or one that turns a face away from it, or from the other eye alone.
    """
    jig = scene.jig
    for _ in range(300_000):
        turn = Rotation.random(rng=rng).as_matrix()
        degrees = incidences(turn, apex, edge)
        fits = degrees.max() < 80
        if jig == "turned away":
            fits = degrees.max() > 93 and np.sort(degrees)[1] < 75
        if scene.steepest_deg is not None:
            fits = abs(degrees.max() - scene.steepest_deg) < 0.5 and np.sort(degrees)[1] < 70
            fits = fits and incidences(turn, apex - other_eye, edge).max() < 86
        if fits and (jig != "in shadow" or incidences(turn, apex - other_eye, edge).max() > 91):
            return turn
    raise AssertionError("no attitude found")


def incidences(turn: NDArray, apex: NDArray, edge: float) -> NDArray:
    """Angles (3,) between the line of sight to each face's middle and the face's outward normal."""
    middles = apex + edge / 3 * (turn.sum(axis=1) - turn.T)
    cosine = np.einsum("fi,fi->f", middles, turn.T) / np.linalg.norm(middles, axis=1)
    return np.degrees(np.arccos(cosine))


def scan_of(shape: JigShape, scanner: Scanner, scene: Scene, rng: np.random.Generator) -> MeshScan:
    """A scan drawn from the generator; equal generators give equal scans."""
    edge = shape.edge
    apex = np.array([*rng.uniform(-0.3, 0.3, 2) * edge, scanner.distance + rng.uniform(-0.3, 0.3) * edge])
    other_eye = np.array([0.0, 1, 0] if scanner.kind == "laser lines" else [1.0, 0, 0]) * scanner.baseline
    turn = attitude(apex, edge, rng, scene, other_eye)
    view_T_jig = transform(turn, apex)
    made = jig_mesh(shape, rng).moved(view_T_jig)
    others = robot_behind(view_T_jig, edge, rng, scene.jig == "cube instead")
    if scene.jig == "absent":
        made = Mesh(made.vertices_mm, made.triangles[:0], made.label[:0])
    elif scene.jig == "cube instead":
        cube = box((edge, edge, edge)).moved(transform(np.eye(3), np.full(3, edge / 2)))
        made = cube.moved(view_T_jig)
    elif scene.jig == "covered":
        wide, thick = edge * rng.uniform(1.2, 2.0), rng.uniform(0.05, 0.3) * edge
        lid = box((thick, wide, wide)).moved(
            transform(np.eye(3), np.array([-thick / 2 - rng.uniform(0.1, 2), 0.25 * edge, 0.25 * edge]))
        )
        others.append(lid.moved(view_T_jig))
    if scene.bracket:
        others += bracket(view_T_jig, edge, rng)
    if scene.cable:
        others += cable(apex, edge, rng)
    if scene.workshop:
        others += workshop(apex, edge, rng)
    elif scene.jig == "absent":
        way = np.array([90.0, 20, 0])
        others.append(rod(apex - way, apex + way, 20.0))
    rays = Rays(joined([made, *others]))
    seen = SCANNERS[scanner.kind](rays, scanner, apex, rng)
    # A laser's camera moves with it, and may come to see from elsewhere what is in shadow from the middle.
    has_jig = scene.jig in ("in view", "in shadow")
    covariance, share = np.full((3, 3), np.nan), np.zeros(3)
    if has_jig:
        covariance = bound(seen, turn, apex, scanner.heavy_tails)
        clear = replace(scanner, patches=0)
        alone = SCANNERS[scanner.kind](Rays(made), clear, apex, np.random.default_rng(0))
        there, possible = (np.bincount(s.label[s.label >= 0], minlength=5)[:3] for s in (seen, alone))
        share = there / np.maximum(possible, 1)
        has_jig = bool(there.min() >= 4)
    # From the view frame to the file's: turned anyhow about the eye, perhaps with the origin elsewhere.
    away = rng.standard_normal(3)
    file_T_view = transform(Rotation.random(rng=rng).as_matrix(), scanner.origin_away * away / np.linalg.norm(away))
    axes, shift = file_T_view[:3, :3], file_T_view[:3, 3]
    points = (seen.points_mm @ axes.T + shift).astype(np.float32).astype(float)
    label = seen.label
    if scanner.no_depth != "left out":
        gaps = np.sort(rng.integers(len(points), size=len(points) // 3))
        nothing = np.nan if scanner.no_depth == "nan" else 0.0
        points, label = np.insert(points, gaps, nothing, axis=0), np.insert(label, gaps, MIXED)
    return MeshScan(
        Scan(scanner.kind, points), label, axes @ apex + shift, axes @ covariance @ axes.T, has_jig, share,
        incidences(turn, apex, edge), edge,
    )  # fmt: skip


def bound(seen: Seen, turn: NDArray, apex: NDArray, heavy_tails: bool) -> NDArray:
    """Cramer-Rao bound (3, 3) of the place where three free planes meet, from their points' true places and sigmas.

    Of plane i the points know height and two slopes with information I = sum a a^T / sigma^2, a = (1, u, v) from the
    apex; the height's variance there is 1 / (I_hh - I_hs I_ss^-1 I_sh), and the apex moves by -height along edge i.
    Student's t of n degrees, scaled to the same sigma, tells n (n + 1) / ((n - 2) (n + 3)) times as much.
    """
    more = TAILS * (TAILS + 1) / ((TAILS - 2) * (TAILS + 3)) if heavy_tails else 1.0
    variance = np.zeros(3)
    for face in range(3):
        on = seen.true_label == face
        if on.sum() < 4:
            return np.full((3, 3), np.nan)
        weight = more / seen.normal_sigma_mm[on] ** 2
        slopes = (seen.true_mm[on] - apex) @ np.delete(turn, face, axis=1)
        mixed = weight @ slopes
        known = weight.sum() - mixed @ np.linalg.solve((slopes * weight[:, None]).T @ slopes, mixed)
        variance[face] = 1 / known
    return np.asarray((turn * variance) @ turn.T)
