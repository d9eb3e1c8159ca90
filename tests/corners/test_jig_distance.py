"""Distances of points at known heights over the jig's faces, for any pose of the jig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import frames
from calib.corners.intersection import Corner, Face
from calib.corners.jig_distance import REACH, face_distances, jig_outline, place_jig
from calib.errors import ScanError
from calib.jig import Jig, Outline, jig_geometry

JIG = Jig(edge_mm=60.0)
OUTLINE = JIG.outlines()[0]


def face_at(normal: np.ndarray, apex: np.ndarray, number: int) -> Face:
    """Face through the apex, of arbitrary covariance."""
    axes = np.linalg.svd(normal[None])[2][1:]
    return Face(normal, float(normal @ apex), apex, 0, 0.0, np.zeros(0, dtype=np.uint8), number, axes, np.eye(3))


def corner_at(motion: np.ndarray, order: tuple[int, ...] = (0, 1, 2)) -> Corner:
    """A cube's corner, its edges along minus the axes of a frame and its faces turned outwards; faces in any order."""
    apex = motion[:3, 3]
    normals = motion[:3, :3].T[list(order)]  # face k is spanned by the other two axes
    faces = tuple(face_at(n, apex, number) for number, n in enumerate(normals))
    return Corner(apex, np.eye(3), faces, np.eye(9), None, OUTLINE)  # type: ignore[arg-type]  # how good it is plays no part


def motion(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return frames.make_transform(frames.rotation_from_rotvec(rng.normal(size=3)), rng.normal(size=3) * 300)


@given(seed=st.integers(0, 2**32 - 1), order=st.permutations([0, 1, 2]))
def test_heights_over_the_faces_come_back_with_their_sign_and_face(seed: int, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    placed = motion(seed)
    face = rng.integers(0, 3, 200)  # axis across which the point's face lies
    points = -rng.uniform(4.0, 25.0, (200, 3))  # inside the triangle: u + v < 50 of 60
    height = rng.uniform(-2.5, 2.5, 200)
    points[np.arange(200), face] = height
    corner = corner_at(placed, tuple(order))
    distance, nearest = face_distances(frames.apply(placed, points), corner, JIG)
    np.testing.assert_allclose(distance, height, atol=1e-9)
    assert (np.array(order)[nearest] == face).all()


def test_points_beside_the_jig_or_far_from_it_have_no_distance() -> None:
    placed = motion(1)
    reach = REACH * JIG.edge_mm
    points = np.array(
        [
            [-40.0, -40.0, 0.0],  # in the plane, beyond the triangle's third side
            [10.0, -20.0, 0.0],  # in the plane, on the other side of the apex
            [-10.0, -20.0, 1.01 * reach],  # over the face, too far
            [-10.0, -20.0, 0.99 * reach],
            [-10.0, -10.0, -10.0],  # inside the jig
        ]
    )
    distance, nearest = face_distances(frames.apply(placed, points), corner_at(placed), JIG)
    assert np.isnan(distance).tolist() == [True, True, True, False, True]
    assert nearest.tolist() == [-1, -1, -1, 2, -1]


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 0, 2), (0, 2, 1)])
def test_the_jigs_model_lies_on_the_estimated_faces(order: tuple[int, ...]) -> None:
    placed = motion(7)
    corner = corner_at(placed, order)
    triangles = jig_outline(corner, JIG)
    for face, triangle in zip(corner.faces, triangles, strict=True):
        np.testing.assert_allclose(triangle @ face.normal, face.offset_mm, atol=1e-9)
        np.testing.assert_allclose(triangle[0], corner.xyz_mm)
        sides = triangle[1:] - triangle[0]
        np.testing.assert_allclose(np.linalg.norm(sides, axis=1), JIG.edge_mm)
        # The edges leave the apex into the solid, away from where the normals point.
        assert (sides @ np.array([f.normal for f in corner.faces]).T <= 1e-9).all()
    transform, faces = place_jig(corner, JIG)
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1.0)
    assert sorted(faces) == [0, 1, 2]


def test_a_jig_with_measured_angles_has_each_face_where_it_was_found() -> None:
    jig = Jig(edge_mm=50.0, face_angles_deg=(89.0, 90.5, 92.0))
    placed = motion(3)
    edges, normals = jig_geometry(jig)
    turned, apex = normals[[2, 0, 1]] @ placed[:3, :3].T, placed[:3, 3]
    faces = tuple(face_at(n, apex, i) for i, n in enumerate(turned))
    corner = Corner(apex, np.eye(3), faces, np.eye(9), None, OUTLINE)  # type: ignore[arg-type]
    transform, order = place_jig(corner, jig)
    assert order == (2, 0, 1)
    np.testing.assert_allclose(transform, placed, atol=1e-9)
    assert len(edges) == 3


@pytest.mark.parametrize("told", [(30.0, 50.0, 70.0), (50.0, 70.0, 30.0), (50.0, 30.0, 70.0)])
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 0, 2)])
@pytest.mark.parametrize("rectangular", [False, True])
def test_three_different_edges_lie_where_the_scan_shows_them(
    told: tuple[float, float, float], order: tuple[int, int, int], rectangular: bool
) -> None:
    lengths = (30.0, 50.0, 70.0)  # along minus x, y and z of the placed frame; edge i leaves face i
    i, j, k = order
    shown = Outline((lengths[i], lengths[j], lengths[k]), rectangular)
    placed = motion(11)
    corner = replace(corner_at(placed, order), outline=shown)
    jig = Jig(edge_mm=told)
    triangles = jig_outline(corner, jig)
    assert len(triangles) == (6 if rectangular else 3)
    for face, triangle in zip(order, triangles, strict=False):
        ends = frames.apply(frames.invert(placed), triangle[1:])
        there = [-lengths[axis] * np.eye(3)[axis] for axis in range(3) if axis != face]
        apart = np.linalg.norm(ends[:, None] - np.array(there), axis=2)
        assert apart.min(axis=0) == pytest.approx(0.0, abs=1e-9)
    points = np.array([[0.5, -20.0, -40.0], [0.5, -40.0, -60.0], [0.5, -60.0, -10.0], [0.0, 0.0, 900.0]])
    distance, nearest = face_distances(frames.apply(placed, points), corner, jig)
    np.testing.assert_allclose(distance, [0.5, 0.5 if rectangular else np.nan, np.nan, np.nan], atol=1e-9)
    assert nearest[0] == order.index(0)


def test_points_of_another_shape_are_refused() -> None:
    with pytest.raises(ScanError, match=r"shape \(4, 2\)"):
        face_distances(np.zeros((4, 2)), corner_at(np.eye(4)), JIG)
    assert len(face_distances(np.zeros((0, 3)), corner_at(np.eye(4)), JIG)[0]) == 0
