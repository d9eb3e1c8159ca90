"""Jang's experiment made anew on sample_data, beside the paper's figure 15 and Table 1.

Run from the project's folder: `.venv/bin/python benchmarks/jang.py [DATASET ...]`; further dataset folders (real arms)
are calibrated by positions and listed below.
"""

from __future__ import annotations

import csv
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from calib import calibrate, find_corners
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.dataset.repeats import repeats_of
from calib.measurement.measured_points import with_corners
from calib.options import FitOptions

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "tests" / "reference"


def rows(name: str) -> list[dict[str, str]]:
    """A table of the paper."""
    with (REFERENCE / name).open() as stream:
        return list(csv.DictReader(stream))


def figure_15(dataset: Dataset) -> None:
    """Distance errors before and after, training and test."""
    print("Distance error to the reference pose, mm (Jang 2025, figure 15; the paper's arm is real, ours simulated)")
    print(f"{'':18} {'before':>9} {'after':>9} {'fall':>8}   {'paper: before':>13} {'after':>9} {'fall':>8}")
    results = {kind: calibrate(dataset, FitOptions(kind)) for kind in ("distance", "position")}
    for kind, result in results.items():
        print(f"fitted by {kind}s")
        for row in rows("jang_fig15_distance_error.csv"):
            before, after = (getattr(e, row["set"]) for e in (result.before, result.after))
            name = "distance_max_mm" if row["statistic"] == "abs_max" else "distance_mean_mm"
            a, b = getattr(before, name), getattr(after, name)
            label = f"{row['set']} {row['statistic'].removeprefix('abs_')}"
            print(
                f"  {label:16} {a:9.4f} {b:9.4f} {100 * (1 - b / a):7.2f}%   {float(row['before_mm']):13.4f} "
                f"{float(row['after_mm']):9.4f} {float(row['reduction_percent']):7.2f}%"
            )
    by_iteration = " ".join(f"{step.train_distance_rmse_mm:.4f}" for step in results["distance"].iteration_errors)
    print(f"training RMSE of the distances by iteration (paper: settles at 0.0989 by the 4th): {by_iteration}")


def table_1(dataset: Dataset) -> None:
    """Ten corners of a standing arm: deviation by axis, and the mean's distance from where the apex really is."""
    truth = json.loads((ROOT / "tests" / "truth" / f"{dataset.name}.json").read_text())["apex_mm"]
    print("\nRepeats, mm (Jang 2025, Table 1; error: the mean from the paper's reference row, ours from the truth)")
    print(f"{'point':6} {'sigma x':>8} {'y':>8} {'z':>8} {'error':>8}   {'paper: x':>9} {'y':>8} {'z':>8} {'error':>8}")
    paper = rows("jang_table1_repeats.csv")
    assert dataset.points is not None
    for name in ("P1", "P2", "P3", "P4"):
        of = [k for k, i in enumerate(dataset.points.pose) if dataset.poses.ids[i].startswith(name)]
        ours = repeats_of(name, dataset.points.xyz_mm[of], truth[dataset.poses.ids[dataset.points.pose[of[0]]]])
        xyz = {r["cycle"]: [float(r[f"{a}_mm"]) for a in "xyz"] for r in paper if r["point"] == name}
        reference = xyz.pop("reference")
        theirs = repeats_of(name, list(xyz.values()), reference)
        print(
            f"{name:6} {' '.join(f'{v:8.4f}' for v in ours.sigma_mm)} {ours.offset_mm:8.4f}    "
            f"{' '.join(f'{v:8.4f}' for v in theirs.sigma_mm)} {theirs.offset_mm:8.4f}"
        )


def real(path: Path) -> None:
    """A measured arm: 3D error of the held-out poses."""
    result = calibrate(load_dataset(path))
    before, after = result.before.test, result.after.test
    if before is not None and after is not None:
        print(
            f"{result.dataset.name}: held-out RMSE {before.rmse_mm:.3f} -> {after.rmse_mm:.4f} mm over {after.points} "
            f"points ({', '.join(result.after.notes) or 'frame from training poses'})"
        )


if __name__ == "__main__":
    measured = {}
    for name in ("rb5_jang", "rb5_repeats"):
        scans = load_dataset(ROOT / "sample_data" / name)
        searches = find_corners(scans)
        seconds = [search.seconds for search in searches.values()]
        print(f"{name}: {sum(s.corner is not None for s in searches.values())} of {len(searches)} corners, "
              f"median {np.median(seconds):.2f} s a scan")  # fmt: skip
        measured[name] = with_corners(scans, searches)
    figure_15(measured["rb5_jang"])
    table_1(measured["rb5_repeats"])
    print()
    for argument in sys.argv[1:]:
        real(Path(argument))
