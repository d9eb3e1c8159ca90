"""Coverage of 90 % intervals: the share of test coordinates within 1.645 promised standard deviations.

    python benchmarks/promise.py [FOLDER ...] [--arms 40] [--diagnosed 12]

FOLDER: recordings of real arms, by link errors alone (`calibrate`) and by the last model of `diagnose`, beside the rms
of the training errors taken for sigma. Then simulated arms with 20, 50 and 200 training poses, nothing hidden and with
an effect that the fit does not have, and diagnosed ones.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import calib
from calib.calibration.promise import Z_90, promise
from calib.calibration.result import Calibration, FittedResult
from calib.dataset.dataset import Dataset

TEST = 80  # test poses of a simulated arm


def coverages(fit: Calibration) -> tuple[float, float]:
    """Shares of test coordinates within 1.645 rms of the training errors, and within 1.645 promised sigmas."""
    own = promise(fit)
    rms_mm = np.sqrt(np.mean(own.error_mm[~own.is_test] ** 2))
    assert own.coverage_90 is not None
    return float(np.mean(np.abs(own.error_mm[own.is_test]) <= Z_90 * rms_mm)), own.coverage_90


def simulated(seed: int, train: int, effects: Sequence[str]) -> Dataset:
    """An RB5 with 0.05 mm noise, so many training poses and `TEST` test poses."""
    dataset = calib.simulate_dataset(
        "rb5", rng=seed, effects=effects, poses=train + TEST, conditions=bool(effects)
    ).dataset
    role = np.array(["reference", *["train"] * (train - 1), *["test"] * TEST])
    return replace(dataset, poses=replace(dataset.poses, role=role))


def over(arms: int, train: int, effects: Sequence[str], fit: Callable[[Dataset], FittedResult]) -> str:
    """Mean coverages over simulated arms, as a line's end."""
    both = np.array([coverages(fit(simulated(seed, train, effects)).calibration) for seed in range(arms)])
    error = both[:, 1].std(ddof=1) / np.sqrt(arms)
    return f"{both[:, 0].mean():.3f} -> {both[:, 1].mean():.3f} +- {error:.3f}"


def main() -> None:
    """Print the coverages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--arms", type=int, default=40)
    parser.add_argument("--diagnosed", type=int, default=12)
    options = parser.parse_args()
    print("training rms -> promised sigma")
    for folder in options.folders:
        for name, fit in (("links", calib.calibrate(folder)), ("diagnosed", calib.diagnose(folder).calibration)):
            rms, share = coverages(fit)
            print(f"{folder.name}, {name}: {rms:.3f} -> {share:.3f}", flush=True)
    for train in (20, 50, 200):
        for effects in ((), ("transmission_error",), ("joint_compliance",), ("fine_ripple",)):
            said = over(options.arms, train, effects, calib.calibrate)
            print(f"{train} poses, hidden: {', '.join(effects) or 'nothing'}: {said}", flush=True)
    for effects in ((), ("transmission_error",), ("joint_compliance",), ("fine_ripple",)):
        said = over(options.diagnosed, 64, effects, calib.diagnose)
        print(f"64 poses, diagnosed, hidden: {', '.join(effects) or 'nothing'}: {said}", flush=True)


if __name__ == "__main__":
    main()
