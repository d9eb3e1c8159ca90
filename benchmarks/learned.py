"""Curves of the joints that are learned where no named effect explains what is left: how well, and how often in vain.

- clean: arms with link errors and noise alone; how many of them curves are offered for.
- causes: a cause that the catalogue does not have, at 3 sigma; the held-out error of the link errors alone, after the
  diagnosis, and of the same arm without the cause, which is what the true model would reach.
- real: the arms of sample_data that were measured, held out: nominal, link errors, after the diagnosis.

    python benchmarks/learned.py [--arms N]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one thread

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, diagnose
from calib.calibration.result import Calibration
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.screening.curves.joint_curves import learn_joint_curves
from calib.simulation.simulate import simulate_dataset

ROOT = Path(__file__).resolve().parents[1]
CAUSES = ("high_harmonic", "joint_dent", "hose_pull", "joint_step", "rough_gear")
REAL = ("ur10_ipa", "mukca_panda_2_clean")


def arm(seed: int, effects: tuple[tuple[str, float], ...] = ()) -> Dataset:
    """64 poses of an RB5 or a Panda in turn, noise of 0.05 mm."""
    robot = builtin_robot(("rb5", "panda")[seed % 2])
    rng = np.random.default_rng(2000 + seed)
    return simulate_dataset(robot, rng=rng, effects=effects, poses=64, noise_mm=0.05).dataset


def held_out_mm(calibration: Calibration) -> float:
    """3D RMSE of the test poses."""
    assert calibration.after.test is not None
    return calibration.after.test.rmse_mm


def main() -> None:
    """Print all three."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=20, help="of each kind (default 20)")
    arms = parser.parse_args().arms
    offered, seconds = 0, []
    floors = []
    for seed in range(arms):
        calibration = calibrate(arm(seed))
        floors.append(held_out_mm(calibration))
        start = time.perf_counter()
        offered += learn_joint_curves(calibration) is not None
        seconds.append(time.perf_counter() - start)
    print(f"clean: curves offered for {offered} of {arms} arms; {np.median(seconds):.2f} s each (median)")
    for cause in CAUSES:
        ratios, worse, taken = [], 0, 0
        for seed in range(arms):
            found = diagnose(arm(seed, ((cause, 3.0),)))
            before, after = held_out_mm(found.steps[0].calibration), held_out_mm(found.calibration)
            taken += found.learned is not None
            worse += found.learned is not None and held_out_mm(found.learned.after) > held_out_mm(found.learned.before)
            ratios.append((before / floors[seed], after / floors[seed]))
        middle = np.median(ratios, axis=0)
        at_most = np.mean(np.array(ratios)[:, 1] <= 1.3)
        print(
            f"{cause}: held-out error over that without the cause {middle[0]:.2f} -> {middle[1]:.2f} (median), at most "
            f"1.3 in {100 * at_most:.0f} %; curves taken in {taken}, of these worse held out in {worse}, of {arms}"
        )
    for name in REAL:
        start = time.perf_counter()
        found = diagnose(load_dataset(ROOT / "sample_data" / name))
        first, last = found.steps[0].calibration, found.calibration
        assert first.before.test is not None
        print(
            f"{name}: held out {first.before.test.rmse_mm:.4g} mm nominal, {held_out_mm(first):.4g} link errors, "
            f"{held_out_mm(last):.4g} with {', '.join(last.model.family_names) or 'nothing more'}; "
            f"{time.perf_counter() - start:.1f} s"
        )


if __name__ == "__main__":
    main()
