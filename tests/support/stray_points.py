"""Points that are no surface's, added to made scans: uniformly spread, in clumps, mirrored by a shiny face.

As the scenes, they share no code with the product; what is added has the label -1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.scans.scan import Scan
from tests.support.scan_scene import SceneScan

HALF_MM = 80.0  # of the box about the apex in which they are


def spread(scene: SceneScan, rng: np.random.Generator, share: float) -> SceneScan:
    """The scene with `share` times as many further points, uniform in a box about the apex."""
    count = round(share * len(scene.label))
    return with_points(scene, scene.apex_mm + rng.uniform(-HALF_MM, HALF_MM, (count, 3)), rng)


def clumps(scene: SceneScan, rng: np.random.Generator, share: float, number: int = 20) -> SceneScan:
    """The scene with `share` times as many further points in clumps of 1 to 6 mm (sigma) about the apex."""
    count = round(share * len(scene.label))
    middles = scene.apex_mm + rng.uniform(-HALF_MM, HALF_MM, (number, 3))
    axes = np.linalg.qr(rng.standard_normal((number, 3, 3)))[0] * rng.uniform(1.0, 6.0, (number, 1, 3))
    axes[: number // 2, :, 2] *= 0.1  # half of them are flakes
    of = rng.integers(number, size=count)
    return with_points(scene, middles[of] + np.einsum("nij,nj->ni", axes[of], rng.standard_normal((count, 3))), rng)


def reflections(scene: SceneScan, rng: np.random.Generator, share: float, edge_mm: float = 60.0) -> SceneScan:
    """The scene of a concave jig with that share of its pixels showing another face than their own, mirrored.

    Such a point lies on the ray of its pixel, behind the face, at the mirror image of what is seen in it. (The faces of
    a convex corner do not see each other.)
    """
    points_mm, label = scene.scan.points_mm, scene.label
    ghosts, hidden = [], np.zeros(len(label), dtype=bool)
    for mirror in range(3):
        normal = scene.normals[mirror]
        seen = points_mm[(label >= 0) & (label < 3) & (label != mirror)]
        image = seen - 2 * ((seen - scene.apex_mm) @ normal)[:, None] * normal
        crossing = image * ((scene.apex_mm @ normal) / (image @ normal))[:, None]
        along = (crossing - scene.apex_mm) @ scene.normals.T  # the jig's three edges: 0 along that off the face
        inside = np.all(along > -1e-9, axis=1) & (along.sum(axis=1) < edge_mm)
        image = image[inside & (rng.random(len(image)) < share)]
        ghosts.append(image + 0.3 * rng.standard_normal(image.shape))
        hidden |= (label == mirror) & (rng.random(len(label)) < share)
    scan = Scan(scene.scan.name, points_mm[~hidden])
    return with_points(replace(scene, scan=scan, label=label[~hidden]), np.concatenate(ghosts), rng)


def with_points(scene: SceneScan, strays_mm: NDArray, rng: np.random.Generator) -> SceneScan:
    """The scene with further points that are no surface's, in any order."""
    points = np.vstack([scene.scan.points_mm, strays_mm])
    order = rng.permutation(len(points))
    label = np.r_[scene.label, np.full(len(strays_mm), -1)]
    scan = Scan(scene.scan.name, points[order].astype(np.float32).astype(np.float64))
    return replace(scene, scan=scan, label=label[order])
