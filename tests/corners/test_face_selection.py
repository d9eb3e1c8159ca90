"""Choice of the planes that are tried as the jig's faces, among very many."""

from __future__ import annotations

import numpy as np

from calib.corners.plane_triples import Planes, SelectionTolerances
from calib.jig import Jig
from calib.planes.clustering import PlaneGroup
from calib.planes.normals import Neighbourhoods


def test_of_thousands_of_perpendicular_triples_those_with_the_most_points_are_scored_the_jigs_among_them() -> None:
    rng = np.random.default_rng(5)
    apex, jig, planes_a_way = np.array([10.0, -5.0, 700.0]), Jig(), 18
    share = rng.uniform(0, 1, (3, 500, 2))
    share = np.where(share.sum(axis=2, keepdims=True) > 1, 1 - share, share) * jig.shortest_mm
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= -np.sign(turn[2])  # rows: the faces' normals, toward the scanner
    faces = [np.insert(share[i], i, 0.0, axis=1) @ -turn for i in range(3)]
    clutter = rng.uniform(-80, 80, (3000, 3))
    points = apex + np.concatenate([*faces, clutter])
    normals = rng.normal(size=(len(points), 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:1500] = np.repeat(turn, 500, axis=0)
    near = np.zeros((len(points), 20), dtype=np.int64)
    flat, wide = np.full(len(points), 0.02), np.full(len(points), 6.0)
    around = Neighbourhoods(points, normals, flat, 0.01 * flat, near, wide)
    heights = rng.permutation(np.r_[0.0, rng.choice([-1, 1], planes_a_way - 1) * rng.uniform(5, 60, planes_a_way - 1)])
    groups = [
        PlaneGroup(np.arange(5), apex + h * normal, normal, float(normal @ apex + h))
        for h in heights
        for normal in turn
    ]
    planes = Planes(groups, around, jig, SelectionTolerances(0.03, 0.3, 0.5))
    assert len(planes.perpendicular_triples) == planes_a_way**3
    assert len(planes.triples) <= 100
    true = sorted(np.flatnonzero([abs(g.offset_mm - g.normal @ apex) < 1e-9 for g in groups]).tolist())
    assert sorted(max(planes.triples, key=lambda t: t.score.sum()).chosen) == true
    assert len(planes.likeliest_pairs) <= 50
