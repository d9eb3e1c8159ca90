"""Several three-faced jigs in one scan: each found, identified by size, or by the other poses where they are alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.jig import Jig
from calib.scans.scan import Scan
from calib.target_shapes import DeclaredTarget, Sphere
from calib.targets.search import ScanSearch, find_targets_in
from tests.support.scan_scene import jig_rotation, make_scene
from tests.support.sphere_scene import one_ball


def two_jigs(sizes: tuple[float, float], seed: int) -> tuple[Scan, list[np.ndarray]]:
    """Scan of two jigs next to each other, made of one scan of each, and their apexes."""
    rng = np.random.default_rng(seed)
    points, apexes = [], []
    for size, side in zip(sizes, (-75.0, 75.0), strict=True):
        turn = jig_rotation(rng.uniform(0, 15), rng.uniform(0, 360), rng.uniform(0, 120))
        scene = make_scene(rng, 12_000, edge_mm=size, field_mm=2.3 * size, rotation=turn, background=False)
        moved = Rotation.from_rotvec([0.0, side / 700, 0.0]).as_matrix()  # about the scanner: it sees them so
        points.append(scene.scan.points_mm @ moved.T)
        apexes.append(moved @ scene.apex_mm)
    return Scan("two", np.vstack(points)), apexes


def found_in(scan: Scan, *targets: DeclaredTarget) -> ScanSearch:
    search = find_targets_in(scan, targets, scan_sigma_mm=0.02)
    assert isinstance(search, ScanSearch)
    return search


@pytest.mark.parametrize("seed", range(2))
def test_jigs_of_two_sizes_are_told_apart(seed: int) -> None:
    scan, apexes = two_jigs((60.0, 40.0), seed)
    search = found_in(scan, DeclaredTarget("jig", Jig(edge_mm=60.0)), DeclaredTarget("b", Jig(edge_mm=40.0)))
    for found, apex in zip(search.found, apexes, strict=True):
        assert found.failure == ""
        assert len(found.places) == 1
        assert np.linalg.norm(found.places[0].xyz_mm - apex) < 0.05
    assert search.corner is not None


def test_a_jig_of_another_size_is_not_taken_for_the_one_that_is_absent() -> None:
    scan, _ = two_jigs((60.0, 60.0), 5)
    search = found_in(scan, DeclaredTarget("jig", Jig(edge_mm=60.0)), DeclaredTarget("b", Jig(edge_mm=30.0)))
    assert len(search.found[0].places) == 1
    assert search.found[1].places == ()
    assert search.found[1].failure


def test_two_equal_jigs_are_both_found_and_share_their_names() -> None:
    scan, apexes = two_jigs((60.0, 60.0), 7)
    (found,) = found_in(scan, DeclaredTarget("jig", Jig()), DeclaredTarget("b", Jig())).found
    assert found.names == ("jig", "b")
    nearest = [min(np.linalg.norm(place.xyz_mm - apex) for place in found.places) for apex in apexes]
    assert max(nearest) < 0.05


@pytest.mark.slow
def test_a_sphere_beside_what_is_no_jig() -> None:
    scene = one_ball(np.random.default_rng(3), rays=12_000)
    search = found_in(scene.scan, DeclaredTarget("jig", Jig()), DeclaredTarget("b", Sphere(40.0)))
    assert search.found[0].failure
    assert search.found[1].failure == ""
    assert search.failure == ""
