"""Balls on one body, identified by the distances between them."""

from __future__ import annotations

import numpy as np
import pytest

from calib.errors import TargetError
from calib.target_shapes import Spheres
from calib.targets.protocol.finder import Wanted
from calib.targets.spheres.constellation import find_constellation
from tests.support.sphere_scene import Ball, scan_of

RIG = np.array([[0.0, 0, 0], [50.0, 0, 10], [10.0, 70, 0]])
NAMES = ("a", "b", "c")


def wanted(centres: np.ndarray, **changed: float) -> Wanted:
    i, j = np.triu_indices(len(centres), 1)
    apart = tuple(np.linalg.norm(centres[i] - centres[j], axis=1).tolist())
    return Wanted(Spheres(NAMES, apart, 20.0), NAMES, 0.02)


@pytest.mark.parametrize("seed", range(4))
def test_three_balls_get_their_names(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = RIG - RIG.mean(axis=0) + [rng.uniform(-10, 10), rng.uniform(-10, 10), 700.0]
    order = rng.permutation(3)
    scene = scan_of(rng, [Ball(centres[k], 10.0) for k in order], [], rays=12_000)
    found = {place.name: place.xyz_mm for place in find_constellation(scene.scan, wanted(RIG))}
    assert set(found) == set(NAMES)
    for name, centre in zip(NAMES, centres, strict=True):
        assert np.linalg.norm(found[name] - centre) < 0.05


def test_two_of_three_are_found_without_names() -> None:
    rng = np.random.default_rng(9)
    centres = RIG[[0, 2]] + [0.0, -30, 700.0]
    scene = scan_of(rng, [Ball(c, 10.0) for c in centres], [], rays=12_000)
    assert [place.name for place in find_constellation(scene.scan, wanted(RIG))] == ["", ""]


def test_alike_distances_give_no_names_and_others_are_refused() -> None:
    rng = np.random.default_rng(10)
    even = np.array([[0.0, 0, 0], [60.0, 0, 0], [30.0, 60 * np.sqrt(0.75), 0]])
    scene = scan_of(rng, [Ball(c + np.array([-30.0, -20, 700]), 10.0) for c in even], [], rays=12_000)
    assert [place.name for place in find_constellation(scene.scan, wanted(even))] == ["", "", ""]
    with pytest.raises(TargetError, match=r"3 spheres are in view, [\d., ]+ mm apart, none as"):
        find_constellation(scene.scan, wanted(1.3 * RIG))
