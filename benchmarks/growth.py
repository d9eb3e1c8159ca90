"""CPU seconds and memory of the parts of a diagnosis by number of poses: `benchmarks/growth.py [64 1000 ...]`"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, diagnose, screen
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_for, effects_named
from calib.simulation.simulate import simulate_dataset

COUNTS = (64, 1000, 10000)


def tell_growth(counts: Sequence[int]) -> None:
    """Seconds for the parts of a diagnosis and peak memory as the poses become more, and by which power they grow."""
    print("seconds of CPU, RB5 with joint compliance, this process alone; in brackets the power of growth")
    before: tuple[int, dict[str, float]] | None = None
    for count in sorted(counts):
        dataset = simulate_dataset(
            builtin_robot("rb5"),
            rng=np.random.default_rng(count),
            effects=("joint_compliance",),
            visible_sigmas=1.0,
            conditions=True,
            poses=round(count * 80 / 64),
        ).dataset
        spent = pd.DataFrame([seconds_of(dataset) for _ in range(5 if count < 1000 else 1)]).median().to_dict()
        told = [f"{name} {value:.3f}{growth(name, count, spent, before)}" for name, value in spent.items()]
        memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # of the process so far
        poses = np.sum(~dataset.poses.is_test)
        print(f"  {poses} training poses: {', '.join(told)}; peak memory {memory_mb:.0f} MB", flush=True)
        before = (count, spent)


def growth(name: str, count: int, spent: Mapping[str, float], before: tuple[int, Mapping[str, float]] | None) -> str:
    """The power p of time ~ poses^p from one count to the next."""
    if before is None:
        return ""
    return f" ({np.log(spent[name] / before[1][name]) / np.log(count / before[0]):.2f})"


def seconds_of(dataset: Dataset) -> dict[str, float]:
    """CPU time of each part. The refit is the step of the diagnosis: the members and sizes that the evidence chose."""
    clock = [time.process_time()]

    def done() -> None:
        clock.append(time.process_time())

    fitted = calibrate(dataset)
    done()
    best = screen(fitted, effects_for(dataset)).candidates[0]
    done()
    calibrate(dataset, effects=best.members, prior_sigmas=best.prior_sigmas, start=fitted)
    done()
    calibrate(dataset, effects=best.members, prior_sigmas=best.prior_sigmas)
    done()
    calibrate(dataset, effects=effects_named(dataset, ["joint_compliance"]), start=fitted)
    done()
    diagnose(dataset)
    done()
    names = (
        "geometric fit",
        "all families",
        "refit of the best, from that fit",
        "the same from scratch",
        "refit with all joints",
        "diagnosis",
    )
    return dict(zip(names, np.diff(clock).tolist(), strict=True))


if __name__ == "__main__":
    tell_growth([int(count) for count in sys.argv[1:]] or COUNTS)
