"""Park's experiment made anew: exact positions of 64 random poses, every elimination case, both arms.

Prints the RMSE by iteration beside the paper's Tables 7 and 8 and the sums of Tables 9 and 10. Run from the project's
folder: `.venv/bin/python benchmarks/park.py`.
"""

from __future__ import annotations

import csv
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from calib import redundancy  # noqa: E402
from calib.fitting.model import geometric_model  # noqa: E402
from calib.fitting.observations import Observations  # noqa: E402
from calib.fitting.position_residuals import PositionResiduals  # noqa: E402
from calib.fitting.trust_region import solve  # noqa: E402
from calib.kinematics.robot import Robot  # noqa: E402
from tests.support.arms import PANDA_CASES, RB5_CASES, REFERENCE, dataset_of, park_arm, perturbed  # noqa: E402

SEEDS = 100


def rmse_mm(robot: Robot, eliminated: str, seed: int) -> list[float]:
    """3D RMSE after each iteration."""
    rng = np.random.default_rng(seed)
    dataset = dataset_of(robot, perturbed(robot, rng), rng)
    model = geometric_model(robot).with_fixed(eliminated.split())
    fit = solve(PositionResiduals(model, Observations.of(dataset), frame_known=True), prior=False)
    assert fit.converged
    return [0.05 * float(np.sqrt(3 * i.cost / fit.rows)) for i in fit.iterations]


def table_7_or_8(arm: str, cases: tuple[str, ...], file: str) -> None:
    """RMSE and iterations of each elimination case."""
    with (REFERENCE / file).open() as stream:
        paper = list(csv.DictReader(stream))
    columns = [c for c in paper[0] if c != "iteration"]
    print(f"\n{arm}: RMSE in mm, exact positions. Paper (its column for the case) against ours, {SEEDS} random arms")
    head = ("paper, best", "at iteration", "ours, median", "ours, worst", "iterations")
    print(f"{'eliminated':42} {head[0]:>16} {head[1]:>12} {head[2]:>13} {head[3]:>12} {head[4]:>10}")
    for case, column in zip(cases, columns, strict=True):
        runs = [rmse_mm(park_arm(arm), case, seed) for seed in range(SEEDS)]
        last = np.array([run[-1] for run in runs])
        lengths = [len(run) - 1 for run in runs]
        best = min(paper, key=lambda row: float(row[column]))
        print(
            f"{case or 'none':42} {float(best[column]):16.2e} {best['iteration']:>12} {np.median(last):13.2e} "
            f"{last.max():12.2e} {min(lengths):>5}-{max(lengths)}"
        )


def sums() -> None:
    """Print the content of Tables 9 and 10."""
    print("\nTables 9 and 10: the sums, whichever parameter is kept (paper: 111.21 mm and 0.00075 rad)")
    for arm, cases in (("rb5", RB5_CASES), ("panda", PANDA_CASES)):
        robot = park_arm(arm)
        table = robot.table
        if arm == "rb5":
            table[1, 2] += 0.51
        table[0, 3] += 0.00075
        for case in cases:
            rng = np.random.default_rng(4)
            dataset = dataset_of(robot, robot.with_table(table), rng)
            model = geometric_model(robot).with_fixed(case.split())
            fit = solve(PositionResiduals(model, Observations.of(dataset), frame_known=True), prior=False)
            found = model.calibrated_robot(fit.x).table
            lengths = f"d2+d3+d4 = {found[1:4, 2].sum():.6f} mm, " if arm == "rb5" else ""
            print(f"{arm:6} {case or 'none':42} {lengths}theta1+beta1 = {found[0, 3] + found[0, 4]:.8f} rad")


def ranks() -> None:
    """Print how many parameters the pairwise method keeps, and how many can be known."""
    print("\nRedundancy: Park's kept parameters against the rank")
    for arm in ("rb5", "panda"):
        rng = np.random.default_rng(0)
        robot = park_arm(arm)
        dataset = dataset_of(robot, robot, rng, poses=40)
        position, distance = redundancy(dataset), redundancy(dataset, residual="distance")
        print(
            f"{arm:6} {len(robot.parameter_names)} parameters, Park keeps {len(position.kept)}, "
            f"positions can tell {position.rank}, distances {distance.rank}"
        )


if __name__ == "__main__":
    ranks()
    table_7_or_8("rb5", RB5_CASES, "park_table7_rb5_rmse.csv")
    table_7_or_8("panda", PANDA_CASES, "park_table8_panda_rmse.csv")
    sums()
