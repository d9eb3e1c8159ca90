"""Bows of a jig's faces by all scans together, on scans of a ray caster that shares no code with the search."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.corners.batch import CornerBatch, JigShape, of_one_jig
from calib.corners.correlated_noise.bow import TERMS, heights
from calib.corners.search import CornerSearch, find_corner
from calib.dataset.dataset import Dataset
from calib.jig import Jig
from calib.present.results import presentation
from calib.rendering.text import text
from calib.simulation.simulate import simulate_dataset
from tests.support.scan_scene import SceneScan, make_scene

SCANS = 12


@cache
def scanned(bows_mm: tuple[float, float, float], seed: int, **scene) -> tuple[list[SceneScan], JigShape]:
    """Scans of one jig in many attitudes, and what they tell together."""
    made = [make_scene(np.random.default_rng([k, seed]), bows_mm=bows_mm, **scene) for k in range(SCANS)]
    return made, of_one_jig({f"p{k}": find_corner(each.scan) for k, each in enumerate(made)}, Jig())


def errors(made: list[SceneScan], searches: dict[str, CornerSearch], *, flat: bool = False) -> tuple[float, float]:
    """RMS of the apexes' errors, mm, and mean squared error over the covariance: 3 is honest."""
    squares, in_sigmas = [], []
    for each, search in zip(made, searches.values(), strict=True):
        assert search.corner is not None
        corner = search.corner
        if flat:
            corner = (corner.free or corner).flat or corner
        error = corner.xyz_mm - each.apex_mm
        squares.append(error @ error)
        in_sigmas.append(error @ np.linalg.solve(corner.covariance_mm2, error))
    return float(np.sqrt(np.mean(squares))), float(np.mean(in_sigmas))


@pytest.mark.parametrize("bows_mm", [(0.05, 0.05, 0.05), (0.05, -0.03, 0.02)], ids=["alike", "different"])
def test_scans_of_a_jig_with_bowed_faces_learn_them_once(bows_mm):
    made, shape = scanned(bows_mm, 12)
    true_mm = np.array(bows_mm) * 8 / 9  # of a sphere, over the middle of a triangle
    ways = [np.roll(order, turn) for order in (true_mm, true_mm[::-1]) for turn in range(3)]
    off = min(np.abs((np.array(shape.bows.sag_mm) - way) / shape.bows.sigma_mm).max() for way in ways)
    assert off < 4.0
    before, _ = errors(made, shape.searches, flat=True)
    after, in_sigmas = errors(made, shape.searches)
    assert after < 0.5 * before
    assert in_sigmas < 6.0


@pytest.mark.parametrize("scene", [{}, {"waves_mm": 0.03}, {"fillet_mm": 2.0}], ids=["white", "smooth", "rounded"])
def test_flat_faces_are_not_taken_for_bowed(scene):
    _, shape = scanned((0.0, 0.0, 0.0), 3, **scene)
    assert shape.bows is None


def test_bows_are_the_same_however_often_they_are_told():
    _, shape = scanned((0.05, -0.03, 0.02), 12)
    again = of_one_jig(shape.searches, Jig())
    assert again.bows == shape.bows
    for name, search in shape.searches.items():
        np.testing.assert_array_equal(again.searches[name].corner.xyz_mm, search.corner.xyz_mm)


def test_a_scan_of_another_jig_is_left_as_it_is_and_named():
    _, shape = scanned((0.05, 0.05, 0.05), 12, rays=20_000)
    strange = find_corner(make_scene(np.random.default_rng(5), 20_000, bows_mm=(-0.2, -0.2, -0.2)).scan)
    both = of_one_jig({**shape.searches, "strange": strange}, Jig())
    assert both.bows.outlying == ("strange",)


def test_the_text_and_the_document_tell_of_the_bows():
    _, shape = scanned((0.05, 0.05, 0.05), 12)
    dataset: Dataset = simulate_dataset("rb5", rng=0, poses=SCANS).dataset
    named = replace(dataset.poses, ids=tuple(shape.searches))
    batch = CornerBatch(replace(dataset, poses=named), *shape)
    told = text(presentation(batch))
    assert "12 scans show the jig's faces bowed: their middles rise by +0.0" in " ".join(told.split())
    assert set(batch.to_dict()["face_bows"]) == {"probability", "sag_mm", "sigma_mm", "scans", "outlying"}


@pytest.mark.parametrize("rectangular", [False, True])
def test_parts_of_a_bow_have_mean_square_one_and_no_mean_plane(rectangular):
    """By Monte Carlo over the face."""
    at = np.random.default_rng(0).uniform(size=(400_000, 2))
    at = at if rectangular else at[at.sum(axis=1) < 1]
    columns = heights(at, rectangular)
    np.testing.assert_allclose(columns.T @ columns / len(at), np.eye(TERMS), atol=0.06)
    np.testing.assert_allclose(columns.T @ np.column_stack([np.ones(len(at)), at]) / len(at), 0.0, atol=0.02)
