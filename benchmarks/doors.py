"""Do all doors lead to one verdict? Arms with one to three hidden effects, simulated by code of its own.

Each is diagnosed, and its page's advice is followed button by button from the link errors on. Counted is how often both
end with the same effects, the same test error to a millionth and the same verdict.

    python benchmarks/doors.py [--arms N] [--seed S]
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections import Counter
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one thread

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import diagnose
from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.diagnosis.effect_selection import FitStep
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import CATALOGUE
from calib.simulation.simulate import simulate_dataset
from inspector.session import transitions as sessions
from inspector.session.session import Session

MOST_PRESSES = 12
SAME = 1e-6  # relative


def arm(seed: int) -> tuple[Dataset, tuple[str, ...]]:
    """64 + 16 poses of an RB5 or a Panda in turn, with one to three effects of 1 to 6 sigma."""
    rng = np.random.default_rng([7, seed])
    names = [kind.name for kind in CATALOGUE if kind.testable]
    hidden = tuple(str(name) for name in rng.choice(names, size=1 + seed % 3, replace=False))
    effects = [(name, float(rng.uniform(1.0, 6.0))) for name in hidden]
    robot = builtin_robot(("rb5", "panda")[seed % 2])
    simulation = simulate_dataset(robot, rng=rng, effects=effects, conditions=True, poses=80, noise_mm=0.05)
    return simulation.dataset, hidden


def followed(dataset: Dataset) -> Session:
    """The session of someone who presses the button of each advice."""
    session = sessions.with_screening(sessions.with_calibration(Session(dataset)))
    for _ in range(MOST_PRESSES):
        if session.advice is None:
            break
        session = sessions.with_advice_followed(session)
        session = session if session.diagnosis is not None else sessions.with_screening(session)
    return session


def parameters_of(step: FitStep) -> dict[str, set[str]]:
    """The names of the parameters of each effect in a model."""
    return {effect.name: set(effect.prior_sigmas) for effect in step.selected}


def differences(session: Session, found: Diagnosis) -> list[str]:
    """Names of what differs between the two ends."""
    here = session.diagnosis
    if here is None:
        return ["no verdict"]
    out = []
    if (here.verdict, here.missing, here.suspected, here.ambiguous_set) != (
        found.verdict, found.missing, found.suspected, found.ambiguous_set
    ):  # fmt: skip
        out.append("verdict")
    if parameters_of(session.steps[-1]) != parameters_of(found.steps[-1]):
        out.append("model")
    ours, theirs = session.steps[-1].calibration.after.test, found.calibration.after.test
    if ours is None or theirs is None or not math.isclose(ours.rmse_mm, theirs.rmse_mm, rel_tol=SAME):
        out.append("test error")
    return out


def main() -> None:
    """Print the count, and each arm whose ends differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=40, help="how many (default 40)")
    parser.add_argument("--seed", type=int, default=0, help="of the first arm (default 0)")
    asked = parser.parse_args()
    counted: Counter[str] = Counter()
    start = time.process_time()
    for seed in range(asked.seed, asked.seed + asked.arms):
        dataset, hidden = arm(seed)
        found = diagnose(dataset)
        wrong = differences(followed(dataset), found)
        counted[found.verdict] += 1
        counted["same"] += not wrong
        if wrong:
            print(f"arm {seed} ({', '.join(hidden)}; {found.verdict}): {', '.join(wrong)} differ", flush=True)
    verdicts = ", ".join(f"{n} {v}" for v, n in sorted(counted.items()) if v != "same")
    seconds = time.process_time() - start
    print(f"{counted['same']} of {asked.arms} arms end alike ({verdicts}); {seconds:.0f} s of processor")


if __name__ == "__main__":
    main()
