"""Small datasets and files for tests of the app: made in seconds; some 20 000 scan points are drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.dataset.files.folder import write_dataset
from calib.scans.scan import Scan, load_scan, write_scan
from calib.simulation.scanner import ScanModel
from calib.simulation.simulate import Simulation, simulate_dataset, write_simulation

POSES = 16
BROKEN = 4  # index of the pose whose scan misses the jig
HOSTILE = '<img src=x onerror="window.pwned=1"> & <b>p2</b>'


def scanned_cell(poses: int) -> Simulation:
    """A dataset `cell` of coarse scans."""
    return simulate_dataset(
        "rb5",
        rng=2,
        poses=poses,
        scans=True,
        name="cell",
        scan_model=ScanModel(points=3000, window_mm=80.0),
    )


def write_tiny(folder: Path) -> Path:
    """`folder` with the datasets `cell` (scans, one of them without the jig) and `points` (no scans, odd names)."""
    simulation = scanned_cell(POSES)
    write_simulation(simulation, folder / "cell", truth_path=folder / "truth" / "cell.json")
    broken = folder / "cell" / "scans" / simulation.dataset.poses.scan_names[BROKEN]
    points = load_scan(broken).points_mm
    far = points[points[:, 2] > np.quantile(points[:, 2], 0.6)]  # flange, arm and wall, not the jig
    write_scan(broken, Scan(broken.stem, far))

    measured = simulate_dataset("rb5", rng=3, poses=POSES, name="points").dataset
    ids = (measured.poses.ids[0], HOSTILE, *measured.poses.ids[2:])
    write_dataset(replace(measured, name=HOSTILE, poses=replace(measured.poses, ids=ids)), folder / "points")
    return folder


def box_stl(corner_mm: tuple[float, float, float]) -> str:
    """A link's mesh as a text .stl: one triangle with a corner at the given point."""
    x, y, z = corner_mm
    return (
        "solid link\nfacet normal 0 0 1\nouter loop\n"
        f"vertex {x} {y} {z}\nvertex {x + 10} {y} {z}\nvertex {x} {y + 20} {z}\n"
        "endloop\nendfacet\nendsolid link\n"
    )
