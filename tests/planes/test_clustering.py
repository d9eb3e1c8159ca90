"""Processes 1-3 on cases with known answers, and groups of made planes."""

from __future__ import annotations

import numpy as np
import pytest

from calib.planes.clustering import (
    ClusterTolerances,
    PlaneGroup,
    cluster,
    off_planes,
    process_1,
    process_2,
    process_3,
)
from calib.planes.filters import FilterTolerances, SampleSets, apply_filters

UP = np.array([0.0, 0.0, 1.0])
ORIGIN = np.zeros(3)
TOLERANCES = ClusterTolerances(np.radians(4), np.radians(4), height_mm=0.5, sigma_mm=0.02)


def tilted(degrees: float) -> np.ndarray:
    return np.array([np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))])


def test_process_1_parallel_normals_on_the_same_side() -> None:
    normals = np.stack([UP, tilted(3.9), tilted(4.1), -UP])
    assert process_1(UP, normals, np.radians(4)).tolist() == [True, True, False, False]


def test_process_2_wants_the_way_between_the_centres_in_both_planes() -> None:
    centres = np.array([[30.0, 0, 0], [30, 0, 3], [30, 0, 0], [0, 0, 0.3]])
    normals = np.stack([UP, UP, tilted(10), UP])
    # in the plane; too high for its distance; the set's own plane leaves the way; near by, noise alone tilts the way
    assert process_2(ORIGIN, UP, centres, normals, np.radians(4), 0.5).tolist() == [True, False, False, True]


def test_process_3_is_the_height_between_the_centres() -> None:
    centres = np.array([[90.0, 5, 0.49], [0, 0, -0.49], [3, 0, 0.51]])
    assert process_3(ORIGIN, UP, centres, 0.5).tolist() == [True, True, False]


def sets_on(
    planes: list[tuple[np.ndarray, float]], each: int, sigma_mm: float, seed: int
) -> tuple[SampleSets, np.ndarray]:
    """Sets of four points on 60 mm pieces of planes normal . p = offset, and the plane of each set."""
    rng = np.random.default_rng(seed)
    points, normals, truth = [], [], []
    for number, (normal, offset) in enumerate(planes):
        axes = np.linalg.svd(normal[None])[2][1:]
        middle = rng.uniform(-25, 25, (each, 1, 2)) + rng.uniform(-5, 5, (each, 4, 2))
        points.append(middle @ axes + normal * (offset + sigma_mm * rng.standard_normal((each, 4, 1))))
        normals.append(np.tile(normal, (each, 4, 1)))
        truth.append(np.full(each, number))
    order = rng.permutation(len(planes) * each)
    loose = FilterTolerances((0.0, 50.0), np.radians(20), np.radians(80))
    return apply_filters(np.concatenate(points)[order], np.concatenate(normals)[order], loose), np.concatenate(truth)[
        order
    ]


@pytest.mark.parametrize("seed", range(3))
def test_groups_are_the_planes(seed: int) -> None:
    planes = [(UP, 0.0), (UP, 3.0), (tilted(90), 10.0), (tilted(30), -20.0)]  # two parallel ones 3 mm apart
    sets, truth = sets_on(planes, 120, 0.01, seed)
    groups = cluster(sets, TOLERANCES)
    large = [g for g in groups if len(g.sets) > 30]
    assert len(large) == 4
    for group in large:
        numbers = truth[group.sets]
        number = np.bincount(numbers).argmax()
        assert np.mean(numbers == number) > 0.99
        normal, offset = planes[number]
        assert np.degrees(np.arccos(min(1.0, group.normal @ normal))) < 0.05
        assert abs(group.normal @ (normal * offset) - group.offset_mm) < 0.05


def test_every_passed_set_is_in_exactly_one_group() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-30, 30, (300, 4, 3))
    normals = np.tile(UP, (300, 4, 1))
    sets = apply_filters(points, normals, FilterTolerances((0, 100), 3.2, 1.2))
    groups = cluster(sets, TOLERANCES)
    members = np.concatenate([g.sets for g in groups])
    assert sorted(members) == sets.passed().tolist()
    assert [len(g.sets) for g in groups] == sorted((len(g.sets) for g in groups), reverse=True)


def test_no_sets_no_groups() -> None:
    sets = apply_filters(np.zeros((5, 4, 3)), np.tile(UP, (5, 4, 1)), FilterTolerances((1, 2), 0.1, 0.1))
    assert cluster(sets, TOLERANCES) == ()


def test_points_off_planes_are_those_far_from_them_or_of_another_direction() -> None:
    floor = PlaneGroup(np.zeros(0, dtype=np.int64), np.zeros(3), UP, 0.0)
    points = np.array([[0.0, 0, 0.1], [5, 5, -0.1], [0, 0, 2]])
    assert off_planes([], points, 0.5).tolist() == [True, True, True]
    assert off_planes([floor], points, 0.5).tolist() == [False, False, True]
    leaning = np.array([UP, [0.0, 1, 0], UP])
    assert off_planes([floor], points, 0.5, leaning, np.radians(15)).tolist() == [False, True, True]
