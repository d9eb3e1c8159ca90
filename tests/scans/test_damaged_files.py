"""Damaged files of every format: points or one clear error, and from points a corner or a reason; no other outcome."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib.corners.search import MIN_POINTS, CornerOptions, find_corner
from calib.errors import ScanError
from calib.jig import Jig
from calib.scans.scan import Scan, load_scan
from tests.support.scan_mutations import CLOUDS, MUTATIONS, WRITERS
from tests.support.scan_scene import make_scene

QUICK = CornerOptions(sample_sets=600)
SCENE = make_scene(np.random.default_rng(1), 900, field_mm=90)
FILES = {name: write(SCENE.scan.points_mm) for name, write in WRITERS.items()}
FUNCTION_FOLDER = {"deadline": None, "suppress_health_check": [HealthCheck.function_scoped_fixture]}


def load_or_error(path: Path, content: bytes) -> Scan | None:
    path.write_bytes(content)
    said = ""
    try:
        scan = load_scan(path)
    except ScanError as error:
        said = str(error)
    if said:
        assert said.startswith(str(path))
        assert "\n" not in said
        assert len(said) < len(str(path)) + 400
        return None
    assert len(scan.points_mm) > 0
    assert np.all(np.isfinite(scan.points_mm))
    assert scan.normals is None or scan.normals.shape == scan.points_mm.shape
    return scan


@pytest.mark.parametrize("name", WRITERS)
def test_the_whole_files_hold_the_points(tmp_path: Path, name: str) -> None:
    scan = load_or_error(tmp_path / name, FILES[name])
    points = SCENE.scan.points_mm
    if name.endswith("stl"):
        points = np.unique(np.round(points[: len(points) // 3 * 3], 3), axis=0)
        scan = Scan("", scan.points_mm[np.lexsort(np.round(scan.points_mm, 3).T[::-1])])
    np.testing.assert_allclose(scan.points_mm, points, atol=2e-3)


@pytest.mark.slow
@settings(max_examples=400, **FUNCTION_FOLDER)
@given(name=st.sampled_from([*WRITERS]), mutation=st.sampled_from([*MUTATIONS]), seed=st.integers(0, 2**32))
def test_a_damaged_file_is_points_or_one_error(tmp_path: Path, name: str, mutation: str, seed: int) -> None:
    load_or_error(tmp_path / name, MUTATIONS[mutation](np.random.default_rng(seed), FILES[name]))


@pytest.mark.slow
@settings(max_examples=30, **FUNCTION_FOLDER)
@given(name=st.sampled_from([*WRITERS]), mutation=st.sampled_from([*MUTATIONS]), seed=st.integers(0, 2**32))
@pytest.mark.filterwarnings("error")
def test_what_can_be_loaded_is_a_corner_or_a_reason(tmp_path: Path, name: str, mutation: str, seed: int) -> None:
    scan = load_or_error(tmp_path / name, MUTATIONS[mutation](np.random.default_rng(seed), FILES[name]))
    if scan is None or len(scan.points_mm) < MIN_POINTS:
        return
    found = find_corner(scan, Jig(), scan_sigma_mm=0.02, options=QUICK)
    assert (found.corner is None) == bool(found.failure)
    assert "\n" not in found.failure


@pytest.mark.parametrize("cloud", CLOUDS)
@pytest.mark.filterwarnings("error")
def test_a_cloud_without_the_jig_is_told(tmp_path: Path, cloud: str) -> None:
    for seed, name in enumerate(("little.ply", "plain.xyz", "stored.npz")):
        points = CLOUDS[cloud](np.random.default_rng(seed))
        scan = load_or_error(tmp_path / name, WRITERS[name](points))
        if scan is not None:
            found = find_corner(scan, Jig(), scan_sigma_mm=0.02, options=QUICK)
            assert found.corner is None
            assert found.failure


def test_a_million_rows_without_a_value(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=np.full((1_000_000, 3), np.nan))
    with pytest.raises(ScanError, match="no usable point, 1000000 in the file"):
        load_scan(tmp_path / "a.npz")
