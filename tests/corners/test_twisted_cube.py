"""A cube of three layers whose middle one is turned: no corner of the whole cube, but corners of its outer layers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.corners.search import find_corner
from calib.jig import Jig
from calib.scans.scan import Scan

LAYER_MM, WIDTH_MM = 19.0, 57.0
FAR_MM = 380.0


def scan(seed: int, twist_deg: float) -> tuple[Scan, np.ndarray]:
    """Points that a camera at the origin sees, and the corners (8, 3) of the cube before it was twisted."""
    import open3d

    rng = np.random.default_rng(seed)
    scene = open3d.t.geometry.RaycastingScene()
    toward = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0]  # a corner towards the camera
    turn = (Rotation.from_rotvec(rng.uniform(-0.2, 0.2, 3)) * toward).as_matrix()
    middle = np.array([5.0, -8.0, FAR_MM])
    for layer in range(3):
        box = open3d.geometry.TriangleMesh.create_box(LAYER_MM, WIDTH_MM, WIDTH_MM)
        box.translate([(layer - 1.5) * LAYER_MM, -WIDTH_MM / 2, -WIDTH_MM / 2])
        if layer == 1:
            box.rotate(Rotation.from_euler("x", twist_deg, degrees=True).as_matrix(), center=np.zeros(3))
        box.rotate(turn, center=np.zeros(3)).translate(middle)
        scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(box))
    u, v = np.meshgrid(np.linspace(-0.14, 0.16, 130), np.linspace(-0.17, 0.13, 130))
    rays = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hits = scene.cast_rays(open3d.core.Tensor(np.hstack([0 * rays, rays]).astype(np.float32)))["t_hit"].numpy()
    seen = np.isfinite(hits)
    points = rays[seen] * (hits[seen] + rng.normal(0, 0.03, np.count_nonzero(seen)))[:, None]
    corners = WIDTH_MM * (np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T - 0.5)
    return Scan("cube", points), corners @ turn.T + middle


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_twisted_cube_is_no_cube_but_its_layers_are_boxes(seed: int) -> None:
    twisted, corners = scan(seed, 45.0)
    assert find_corner(twisted, Jig(edge_mm=WIDTH_MM)).corner is None
    layer = find_corner(twisted, Jig(edge_mm=(LAYER_MM, WIDTH_MM, WIDTH_MM))).corner
    away = np.linalg.norm(corners - layer.xyz_mm, axis=1)
    sideways = 2 * LAYER_MM  # the other layer's corner lies so far beside the cube's
    assert away.min() < 0.1 or np.abs(away - sideways).min() < 0.1
    whole, corners = scan(seed, 0.0)
    cube = find_corner(whole, Jig(edge_mm=(WIDTH_MM, WIDTH_MM, WIDTH_MM))).corner
    assert np.linalg.norm(cube.xyz_mm - corners, axis=1).min() < 0.1
