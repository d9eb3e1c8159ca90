"""Verdicts on simulated scans with a structured-light scanner's noise, nothing or one cause hidden.

    python benchmarks/noisy_scans.py [--arms 3] [--effect joint_compliance] [--white]

RB5 and Panda in turn, the scanner in the room and on the flange, 64 scans each. Columns: mean squared error of the
corners in units of their covariance (3 is honest), what the fit leaves over the declared noise, the verdict, the causes
claimed, the held-out error in mm. About 15 s a line.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from calib import diagnose
from calib.corners.batch import declared_noise, of_one_jig
from calib.corners.search import CornerOptions, CornerSearch, find_corner
from calib.dataset.files.robot_toml import builtin_robot
from calib.measurement.measured_points import found_corners, with_corners
from calib.simulation.scanner import PLAIN_MODEL, STRUCTURED_LIGHT, ScanModel
from calib.simulation.simulate import simulate_dataset


def line(seed: int, mount: str, effects: list[str], model: ScanModel) -> str:
    """Line of the table for one arm: its scans, its corners and its diagnosis."""
    robot = replace(builtin_robot(("rb5", "panda")[seed % 2]), carries_scanner=mount == "flange")
    made = simulate_dataset(robot, rng=np.random.default_rng(seed), scans=True, effects=effects, scan_model=model)
    scanner = made.dataset.scanner
    options = CornerOptions(declared=declared_noise(scanner))
    searches: dict[str, CornerSearch] = {}
    for pose, pose_id in enumerate(made.dataset.poses.ids):
        scan = made.scan(pose).scan
        searches[pose_id] = find_corner(scan, made.dataset.jig, scan_sigma_mm=scanner.scan_sigma_mm, options=options)
    searches, _ = of_one_jig(searches, made.dataset.jig)
    true_mm = dict(zip(made.dataset.poses.ids, made.apex_mm, strict=True))
    squared = [
        float((c.xyz_mm - true_mm[p]) @ np.linalg.solve(c.covariance_mm2, c.xyz_mm - true_mm[p]))
        for p, c in found_corners(searches).items()
    ]
    found = diagnose(with_corners(made.dataset, searches))
    test = found.calibration.after.test
    return (
        f"{robot.name:13} {mount:7} {', '.join(effects) or 'nothing':17} {len(squared):3d} of {len(searches)} corners, "
        f"squared error {np.mean(squared):5.2f}, noise {found.calibration.fit.reduced_chi:5.2f}; {found.verdict}: "
        f"{', '.join(found.missing) or 'one of ' * bool(found.ambiguous_set) + ', '.join(found.ambiguous_set) or '-'}; "
        f"{np.nan if test is None else test.rmse_mm:.3f} mm"
    )


def main() -> None:
    """Print a line an arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=3, help="of each mount")
    parser.add_argument("--effect", default="joint_compliance")
    parser.add_argument("--white", action="store_true", help="each point has an error for itself")
    asked = parser.parse_args()
    for mount in ("room", "flange"):
        for seed in range(asked.arms):
            for effects in ([], [asked.effect]):
                print(line(seed, mount, effects, PLAIN_MODEL if asked.white else STRUCTURED_LIGHT))
                sys.stdout.flush()


if __name__ == "__main__":
    main()
