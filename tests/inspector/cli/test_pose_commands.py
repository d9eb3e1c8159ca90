"""Full poses through the command: corners --orientation writes them, calibrate --residual pose fits them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset
from calib.simulation.scanner import ScanModel
from calib.simulation.simulate import simulate_dataset, write_simulation
from tests.support.commands import answered

COARSE = ScanModel(points=6000, window_mm=80.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scans of eleven poses, too few for further processes; enough to place the scanner and to name the faces."""
    folder = tmp_path_factory.mktemp("scans")
    made = simulate_dataset("rb5", rng=2, poses=11, scans=True, scan_model=COARSE)
    write_simulation(made, folder)
    return folder


@pytest.mark.slow
def test_corners_writes_full_poses_that_calibrate_reads(folder: Path, tmp_path: Path) -> None:
    full = tmp_path / "full.csv"
    told = answered("corners", folder, "--out", full, "--orientation")["orientations"]
    assert told["named_by"] == "robot"
    assert told["refused"] == []
    assert len(told["poses"]) == 11
    assert all(pose["margin"] > 60.0 for pose in told["poses"])
    header = full.read_text().splitlines()[0].split(",")
    assert {"x_mm", "qw", "rzz_rad2", "z_rz_mm_rad"} <= set(header)

    measured = tmp_path / "measured"
    measured.mkdir()
    for name in ("robot.toml", "poses.csv"):
        (measured / name).write_text((folder / name).read_text())
    (measured / "points.csv").write_text(full.read_text())
    text = (folder / "dataset.toml").read_text().replace('scans = "scans"', 'points = "points.csv"')
    (measured / "dataset.toml").write_text(text)
    points = load_dataset(measured).points
    assert points.orientations.known.all()

    found = []
    for path in (folder, measured):  # from the scans at once, and by way of the file
        found.append(answered("calibrate", path, "--residual", "pose"))
    assert found[0]["residual"] == "pose"
    assert found[0]["attitudes"]["after"]["train"]["rmse_rad"] < 5e-4
    assert found[0]["attitudes"]["before"]["train"]["rmse_rad"] > 2e-3
    one, other = ([p["value"] for p in document["parameters"]] for document in found)
    np.testing.assert_allclose(one, other, atol=1e-6)
