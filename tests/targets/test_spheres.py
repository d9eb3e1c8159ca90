"""Spheres in scans of the tests' own ray caster: the centre over its bound, its covariance, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.corners.correlated_noise.declared import NOTHING_DECLARED, DeclaredNoise
from calib.errors import TargetError
from calib.scans.scan import Scan
from calib.target_shapes import Sphere
from calib.targets.protocol.finder import FoundPoint, Wanted
from calib.targets.spheres.sphere_finder import find_spheres
from tests.support.sphere_scene import Ball, BallScan, one_ball, scan_of, surroundings

MOST_RATIO = 1.2  # RMS of error over bound
RAYS = 12_000


def wanted(diameter_mm: float | None, most: int = 1) -> Wanted:
    return Wanted(Sphere(diameter_mm), tuple("abcdef"[:most]), 0.02)


def centre_of(scene: BallScan, diameter_mm: float | None) -> FoundPoint:
    return find_spheres(scene.scan, wanted(diameter_mm))[0]


def judged(scenes: list[BallScan], *, known: bool) -> tuple[float, float]:
    """RMS of the error over its bound, and mean squared Mahalanobis distance."""
    ratios, distances = [], []
    for scene in scenes:
        ball = scene.balls[0]
        found = centre_of(scene, 2 * ball.radius if known else None)
        error = found.xyz_mm - ball.centre
        ratios.append(np.linalg.norm(error) / scene.bound_mm(known=known))
        distances.append(error @ np.linalg.solve(found.covariance_mm2, error))
    return float(np.sqrt(np.mean(np.square(ratios)))), float(np.mean(distances))


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, pytest.param(False, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("case", [{}, {"hidden": 0.4}, {"stray": 0.5}], ids=["plain", "hidden", "stray"])
def test_a_centre_is_at_its_bound(case: dict[str, float], known: bool) -> None:
    scenes = [one_ball(np.random.default_rng(seed), rays=RAYS, **case) for seed in range(2)]  # type: ignore[arg-type]
    ratio, _ = judged(scenes, known=known)
    assert ratio < 1.6  # of three scenes; the mean over many is below 1.2


def test_stray_points_in_the_shadow_of_what_hides_half_a_sphere_do_not_disprove_it() -> None:
    """As many strays as points, all within 80 mm: there are more of them behind the sphere than points on it."""
    rng = np.random.default_rng(4)
    scene = one_ball(rng, rays=RAYS, hidden=0.5)
    points, ball = scene.scan.points_mm, scene.balls[0]
    strays = ball.centre + rng.uniform(-80, 80, points.shape)
    found = find_spheres(Scan("strays", np.vstack([points, strays])), wanted(2 * ball.radius))[0]
    error = found.xyz_mm - ball.centre
    assert np.linalg.norm(error) < 3 * scene.bound_mm(known=True)
    assert error @ np.linalg.solve(found.covariance_mm2, error) < 16


@pytest.mark.thorough
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("diameter_mm", [20.0, 40.0, 100.0])
def test_many_centres_are_at_their_bound(diameter_mm: float, known: bool) -> None:
    scenes = [one_ball(np.random.default_rng(seed), rays=RAYS, diameter_mm=diameter_mm) for seed in range(25)]
    ratio, squared = judged(scenes, known=known)
    assert ratio < MOST_RATIO
    assert 1.8 < squared < 4.5  # 3 is honest; of 25 scenes it scatters by 0.5


@pytest.mark.thorough
@pytest.mark.parametrize(("hidden", "known"), [(0.0, True), (0.5, False)])
@pytest.mark.parametrize("declared", [NOTHING_DECLARED, DeclaredNoise(0.03, 15.0)], ids=["shown", "declared"])
def test_a_centre_knows_of_errors_that_neighbours_share(declared: DeclaredNoise, hidden: float, known: bool) -> None:
    """The covariance of independent points would be exceeded 40 to 500 times."""
    squared = []
    for seed in range(8):
        scene = one_ball(np.random.default_rng(seed), rays=RAYS, hidden=hidden, smooth=(0.03, 15.0, "exponential"))
        ball = scene.balls[0]
        asked = replace(wanted(2 * ball.radius if known else None), declared=declared)
        found = find_spheres(scene.scan, asked)[0]
        error = found.xyz_mm - ball.centre
        squared.append(error @ np.linalg.solve(found.covariance_mm2, error))
    assert 1.0 < np.mean(squared) < 6.0  # 3 is honest; of 8 scenes it scatters by 0.9


@pytest.mark.thorough
def test_an_error_along_the_ray_biases_no_free_radius() -> None:
    """A fit of measured points' distances to the centre would be 0.0035 mm too small here, by Monte Carlo."""
    rng = np.random.default_rng(3)
    ball = Ball(np.array([3.0, -2.0, 700.0]), 20.0)
    depth = []
    for _ in range(12):
        scene = scan_of(rng, [ball], [], rays=40_000, field_mm=60.0, sigma_mm=0.1)
        found = find_spheres(scene.scan, replace(wanted(None), scan_sigma_mm=0.1))[0]
        depth.append((found.facts["diameter_mm"] - 40.0) / found.facts["diameter_sigma_mm"])
    assert abs(np.mean(depth)) < 4 / np.sqrt(12)


@pytest.mark.slow
@pytest.mark.parametrize("diameter_mm", [40.0, None])
def test_no_sphere_is_found_where_there_is_none(diameter_mm: float | None) -> None:
    scene = one_ball(np.random.default_rng(5), rays=6_000, absent=True)
    with pytest.raises(TargetError, match=r"; "):
        find_spheres(scene.scan, wanted(diameter_mm))


@pytest.mark.slow
def test_a_sphere_of_another_size_is_told() -> None:
    scene = one_ball(np.random.default_rng(6), rays=RAYS, diameter_mm=40.0)
    with pytest.raises(TargetError, match=r"a sphere of 40.* mm is in view, diameter_mm is 38\.1"):
        find_spheres(scene.scan, wanted(38.1))


def test_several_spheres_are_found_each_once() -> None:
    rng = np.random.default_rng(7)
    balls = [Ball(np.array(at), 12.7) for at in ([-40.0, 0, 690], [35.0, 20, 700], [0.0, -45, 720])]
    scene = scan_of(rng, balls, surroundings(rng, 700.0), rays=RAYS)
    found = find_spheres(scene.scan, wanted(25.4, 3))
    assert len(found) == 3
    nearest = [min(np.linalg.norm(one.xyz_mm - ball.centre) for one in found) for ball in balls]
    assert max(nearest) < 0.05


@pytest.mark.slow
def test_inliers_are_points_of_the_ball_and_same_scan_same_centre() -> None:
    scene = one_ball(np.random.default_rng(8), rays=RAYS)
    holed = np.insert(scene.scan.points_mm, [0, 500, 500], np.nan, axis=0)
    first, again = (find_spheres(Scan("x", p), wanted(40.0))[0] for p in (scene.scan.points_mm, holed))
    assert np.mean(scene.label[first.inliers] == 0) > 0.98
    assert len(again.inliers) == again.points
    np.testing.assert_array_equal(np.linalg.norm(holed[again.inliers] - again.xyz_mm, axis=1).round() - 20, 0)
    np.testing.assert_array_equal(find_spheres(scene.scan, wanted(40.0))[0].xyz_mm, first.xyz_mm)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((60, 3), 700.0), np.full((60, 3), np.nan)])
def test_a_scan_of_nothing_is_refused(points: np.ndarray) -> None:
    for diameter_mm in (None, 40.0):
        with pytest.raises(TargetError):
            find_spheres(Scan("nothing", points), wanted(diameter_mm))
