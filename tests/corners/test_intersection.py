"""Eq (2) and its covariance; scores of an outline; robustness of the refinement and its honesty about noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.corners.faces.face_outline import FaceOutline, outline_shares
from calib.corners.intersection import Face, intersect, intersection_covariance, packed
from calib.corners.refinement import refine
from calib.errors import CornerError
from calib.jig import Jig
from calib.planes.clustering import PlaneGroup

JIG = Jig()
FACE = Face(np.eye(3)[2], 0.0, np.zeros(3), 0, 0.0, np.zeros(0, np.uint8), 0, np.eye(3)[:2], np.eye(3))
NO_SETS = np.zeros(0, dtype=np.int64)
APEX = np.array([12.0, -30.0, 700.0])


def turned(seed: int) -> np.ndarray:
    """Three perpendicular unit normals, as rows, that all face the scanner at the origin."""
    diagonal = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0]
    rng = np.random.default_rng(seed)
    tilt = Rotation.from_euler("zxy", [rng.uniform(0, 6), *rng.uniform(-0.25, 0.25, 2)])
    return (tilt * diagonal).apply(np.eye(3))


@given(seed=st.integers(0, 10**6), shift=st.tuples(*[st.floats(-1e3, 1e3)] * 3))
def test_the_intersection_lies_on_all_planes_and_moves_with_them(seed: int, shift: tuple[float, ...]) -> None:
    rng = np.random.default_rng(seed)
    normals = turned(seed) + 0.1 * rng.standard_normal((3, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = rng.uniform(-500, 500, 3)
    point = intersect(normals, offsets)
    np.testing.assert_allclose(normals @ point, offsets, atol=1e-8)
    np.testing.assert_allclose(intersect(normals, offsets + normals @ shift), point + shift, atol=1e-8)
    rotation = Rotation.random(random_state=seed).as_matrix()
    np.testing.assert_allclose(intersect(normals @ rotation.T, offsets), rotation @ point, atol=1e-8)


def test_covariance_is_what_shifted_planes_do_to_the_point() -> None:
    rng = np.random.default_rng(5)
    normals = turned(5)
    normals[0] = (normals[0] + 0.2 * normals[1]) / np.linalg.norm(normals[0] + 0.2 * normals[1])
    sigmas = np.array([0.1, 0.02, 0.3])
    moved = intersect(normals[None], rng.standard_normal((200_000, 3)) * sigmas)
    np.testing.assert_allclose(np.cov(moved.T), intersection_covariance(normals, np.diag(sigmas**2)), atol=0.0015)


def filled(width: float, height: float, count: int = 3000) -> np.ndarray:
    return np.random.default_rng(2).uniform(0, 1, (count, 2)) * [width, height]


NOTHING = np.zeros((0, 2))
TRIANGLE = FaceOutline((60.0, 60.0))


def worth(on: np.ndarray, behind: np.ndarray = NOTHING) -> float:
    filled, spilt, seen_through = outline_shares(on, np.ones(len(on), dtype=bool), behind, TRIANGLE)
    return filled - spilt - seen_through


def test_a_full_triangle_is_worth_one_and_no_square_reaches_what_the_best_face_must() -> None:
    square = filled(60, 60)
    assert worth(square[square.sum(axis=1) < 60]) > 0.97
    for side in range(20, 121, 4):
        for other in range(20, 121, 20):
            assert worth(filled(side, other)) < 0.8


def test_points_beyond_the_outline_cost_unless_they_belong_to_another_surface() -> None:
    square = filled(60, 60)
    assert 0.4 < outline_shares(square, np.ones(len(square), dtype=bool), NOTHING, TRIANGLE)[1] < 0.8
    assert outline_shares(square, square.sum(axis=1) < 60, NOTHING, TRIANGLE)[1] == 0
    assert worth(filled(90, 90)) < 0.3
    assert worth(NOTHING) == 0


def test_a_hole_that_one_sees_through_costs_and_one_that_nothing_is_known_of_does_not() -> None:
    triangle = filled(60, 60)
    triangle = triangle[triangle.sum(axis=1) < 60]
    in_hole = triangle[:, 0] < 20
    whole = np.count_nonzero(in_hole) / len(triangle)
    shares = outline_shares(triangle[~in_hole], np.ones(np.sum(~in_hole), dtype=bool), triangle[in_hole], TRIANGLE)
    assert shares == pytest.approx((1 - whole, 0, whole), abs=0.1)
    assert worth(triangle[~in_hole]) == pytest.approx(1 - whole, abs=0.1)
    assert worth(triangle, behind=triangle[::4]) > 0.9  # some stray points behind a surface that is there


@given(count=st.integers(4000, 20000))
def test_worth_does_not_depend_on_the_density(count: int) -> None:
    half = filled(60, 30, count)
    assert worth(half[half.sum(axis=1) < 60]) == pytest.approx(0.75, abs=0.08)


def faces(normals: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Exact points on the three faces of a convex jig of edge 60 at the origin, `count` a face."""
    edges = -60 * np.linalg.inv(normals).T
    uv = rng.uniform(0, 1, (3, count, 2))
    uv = np.where(uv.sum(axis=2, keepdims=True) > 1, 1 - uv, uv)
    return np.concatenate([uv[i] @ edges[[(i + 1) % 3, (i + 2) % 3]] for i in range(3)])


def start(normals: np.ndarray, rng: np.random.Generator) -> tuple[PlaneGroup, ...]:
    """Groups whose planes are off by about 0.2 deg and 0.05 mm."""
    off = normals + 0.003 * rng.standard_normal((3, 3))
    off /= np.linalg.norm(off, axis=1, keepdims=True)
    offsets = off @ APEX + 0.05 * rng.standard_normal(3)
    return tuple(PlaneGroup(NO_SETS, d * n, n, float(d)) for n, d in zip(off, offsets, strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_exact_points_give_the_exact_apex(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normals = turned(seed)
    points = APEX + faces(normals, 400, rng)
    corner = refine(points, start(normals, rng), (0, 1, 2), JIG, JIG.outlines()[0], 0.0)
    np.testing.assert_allclose(corner.xyz_mm, APEX, atol=1e-7)
    for face, normal in zip(corner.faces, normals, strict=True):
        np.testing.assert_allclose(face.normal, normal, atol=1e-8)
        assert face.points == len(face.inliers)
        np.testing.assert_allclose(points[face.inliers] @ face.normal, face.offset_mm, atol=1e-6)


@pytest.mark.parametrize("count", [0, 1, 8, 1001])
def test_packed_indices_come_back(count: int) -> None:
    indices = np.flatnonzero(np.random.default_rng(count).random(count) < 0.5)
    bits = packed(indices, count)
    assert bits.nbytes == -(-count // 8)
    np.testing.assert_array_equal(replace(FACE, inlier_bits=bits).inliers, indices)


@pytest.mark.slow
def test_stray_points_on_one_side_do_not_drag_the_corner() -> None:
    squared = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        normals = turned(seed)
        points = faces(normals, 500, rng)
        height = 0.02 * rng.standard_normal(len(points))
        height[rng.random(len(points)) < 0.15] += rng.uniform(0.2, 0.3)
        points = APEX + points + np.repeat(normals, 500, axis=0) * height[:, None]
        corner = refine(points, start(normals, rng), (0, 1, 2), JIG, JIG.outlines()[0], 0.02)
        error = corner.xyz_mm - APEX
        squared.append(error @ np.linalg.solve(corner.covariance_mm2, error))
    assert np.mean(squared) < 4.5  # 3 without them


@pytest.mark.parametrize(
    ("count", "squeeze", "said"), [(5, 1.0, "points on one of the faces"), (400, 0.0, "along a line")]
)
def test_too_little_of_a_face_is_told(count: int, squeeze: float, said: str) -> None:
    rng = np.random.default_rng(1)
    normals = turned(1)
    edges = -60 * np.linalg.inv(normals).T
    points = faces(normals, 400, rng)[: 800 + count]
    third = points[800:]
    along = 0.4 * edges[0] + 0.3 * edges[1]
    points[800:] = squeeze * third + (1 - squeeze) * along * rng.uniform(0.4, 1, (len(third), 1))
    with pytest.raises(CornerError, match=said):
        refine(APEX + points, start(normals, rng), (0, 1, 2), JIG, JIG.outlines()[0], 0.01)
