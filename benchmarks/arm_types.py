"""Arms that begin from their type, beside the same arms alone: `python benchmarks/arm_types.py [--real DIR]`.

Simulated fleets are of `tests.support.engine`, which shares no code with calib: the arms of a fleet have link errors
and a soft joint in common and scatter about these; the last arm of each fleet is fitted to 20 poses, from the others
and alone, and judged at 60 further poses. With --foreign the type is of other arms. With --real the Pandas of a folder
are left out in turn, with several draws of their 20 poses.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from calib import calibrate
from calib.dataset.files.folder import load_dataset
from calib.extras.fleet.arm_type import fit_from_type, learn_type, type_report
from tests.support.fleet_of_type import drawn_fleet

REAL = ("mukca_panda_1", "mukca_panda_2_clean", "mukca_panda_3", "mukca_panda_6", "mukca_panda_7")


def simulated(fleets: int, arms: int, scatter: float, foreign: bool, effects: Sequence[str]) -> None:
    """Print the error of the last arm of each fleet, from its type and alone."""
    ratios = []
    for seed in range(fleets):
        fleet = drawn_fleet(seed, arms=arms, scatter=scatter)
        if foreign:
            fleet = [*drawn_fleet(seed + 3000, arms=arms, scatter=scatter)[:-1], fleet[-1]]
        arm_type = learn_type([calibrate(arm, effects=list(effects)) for arm in fleet[:-1]])
        found = fit_from_type(fleet[-1], arm_type)
        errors = [fit.after.test.rmse_mm for fit in (found.alone, found.calibration) if fit.after.test is not None]
        ratios.append(errors[1] / errors[0])
        print(
            f"{fleet[-1].robot.name:8} {seed:3d}: alone {errors[0]:.3f} mm, from its type {errors[1]:.3f} mm, "
            f"{'of its type' if found.is_of_type else 'alone'}, log Bayes factor {found.log_bayes_factor:.1f}",
            flush=True,
        )
    _told(ratios)


def real(folder: Path, draws: int, effects: Sequence[str]) -> None:
    """Print the error of each Panda, left out of the others, from their type and alone."""
    datasets = [load_dataset(folder / name) for name in REAL]
    ratios: dict[str, list[float]] = {}
    for seed in range(draws):
        for one in type_report(datasets, effects=list(effects), seed=seed).left_out:
            ratios.setdefault(one.name, []).append(one.ratio)
    for name, of_arm in ratios.items():
        print(f"{name}:", end=" ")
        _told(of_arm)
    _told([ratio for of_arm in ratios.values() for ratio in of_arm])


def _told(ratios: Sequence[float]) -> None:
    each = np.array(ratios)
    print(
        f"{len(each)} fits: {np.exp(np.mean(np.log(each))):.3f} of the error alone, from {each.min():.2f} to "
        f"{each.max():.2f}; worse by more than 2 %: {np.count_nonzero(each > 1.02)}",
        flush=True,
    )


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=30)
    parser.add_argument("--arms", type=int, default=6)
    parser.add_argument("--scatter", type=float, default=0.3, help="of the arms about their type, over its own errors")
    parser.add_argument("--foreign", action="store_true", help="the type is of other arms")
    parser.add_argument("--real", type=Path, metavar="DIR")
    parser.add_argument("--draws", type=int, default=6, help="of the 20 poses of each real arm")
    parser.add_argument("--effect", action="append", default=[])
    asked = parser.parse_args()
    if asked.real is not None:
        real(asked.real, asked.draws, asked.effect)
    else:
        simulated(asked.fleets, asked.arms, asked.scatter, asked.foreign, asked.effect)


if __name__ == "__main__":
    main()
