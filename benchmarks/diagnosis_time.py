"""Time of a diagnosis by what is hidden: nothing, a compliance, or a cause that stands in no catalogue.

    python benchmarks/diagnosis_time.py [--poses 64 1000] [--repeats 3]

Arms, causes and measurements come from the tests' simulator (`tests/support/engine`), each cause four times as large as
the noise. Training poses are counted; a quarter as many test poses come on top. Seconds are the processor's on one BLAS
thread, the least of the repeats, without imports; `over compliance` is the ratio to the named cause at as many poses.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from simulated import ROOT  # noqa: F401  # finds the packages

from calib import diagnose
from calib.dataset.dataset import Dataset
from tests.support.engine.cases import Case, simulate

NAMED = "joint_compliance"
UNFORESEEN = (
    *("product_of_joints", "root_of_angle", "creeping_joint", "unwritten_backlash", "late_clock", "swinging_payload"),
    *("hose_pull", "refraction"),
)
SEED, SIGMAS = 7, 4.0


def dataset_with(cause: str, poses: int) -> Dataset:
    """Dataset of an arm with one hidden cause, "" for none, and a number of training poses."""
    causes, sigmas = ((cause,), (SIGMAS,)) if cause else ((), ())
    return simulate(Case("time", causes, 0, SEED, poses=round(1.25 * poses), sigmas=sigmas)).dataset


def seconds(dataset: Dataset, repeats: int) -> tuple[float, str]:
    """Least time of some diagnoses of a dataset, and the verdict with the effects in the model."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        found = diagnose(dataset)
        times.append(time.process_time() - began)
    learned = ("curves",) if found.learned is not None else ()
    return min(times), " ".join([found.verdict, *found.named, *learned])


def main() -> None:
    """Diagnose each dataset and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, nargs="+", default=[64, 1000])
    parser.add_argument("--repeats", type=int, default=3)
    arguments = parser.parse_args()
    diagnose(dataset_with("", 30))  # loads what is loaded once
    for poses in arguments.poses:
        named, _ = seconds(dataset_with(NAMED, poses), arguments.repeats)
        print(f"{poses} poses\n{'hidden':>20} {'s':>7} {'over compliance':>16}  verdict")
        ratios = []
        for cause in ("", NAMED, *UNFORESEEN):
            took, verdict = seconds(dataset_with(cause, poses), arguments.repeats)
            ratios += [took / named] if cause in UNFORESEEN else []
            print(f"{cause or 'nothing':>20} {took:7.2f} {took / named:16.2f}  {verdict}", flush=True)
        print(f"in no catalogue: {np.median(ratios):.2f} times a compliance (median), {max(ratios):.2f} at most")


if __name__ == "__main__":
    main()
