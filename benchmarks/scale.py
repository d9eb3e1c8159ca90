"""Time and memory of a calibration by positions against the number of poses, each count in a process of its own.

    python benchmarks/scale.py [--poses 100 1000 10000 100000] [--residual position|distance|pairs] [--limit-mb 1024]

The arm is the builtin RB5 with link errors and 0.05 mm noise, the scanner's place unknown. Poses are training poses; a
fifth as many are there for testing. `solve` is the fit alone, `calibrate` all that a user calls: the fit and its
evaluation on training and test poses at every iteration, in seconds of the processor. `fit, peak` and `all, peak` are
the process's largest resident memory after either, interpreter and libraries included.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np


def peak_mb() -> float:
    """Largest resident set of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def child(count: int, residual: str) -> None:
    """Measure one number of poses in this process and print a line of JSON."""
    from simulated import NOISE_MM, anywhere, measured, off_by, random_q

    from calib import calibrate
    from calib.dataset.files.robot_toml import builtin_robot
    from calib.fitting.model import geometric_model
    from calib.fitting.observations import Observations
    from calib.fitting.residual_kinds import make_residuals
    from calib.fitting.trust_region import solve
    from calib.options import FitOptions
    from calib.simulation.truth.equilibrium import Truth

    rng = np.random.default_rng(7)
    robot = builtin_robot("rb5")
    truth = Truth.without_effects(off_by(robot, rng, mm=0.3, rad=np.radians(0.1)), anywhere(rng))
    q = random_q(robot, count + count // 5, rng)
    # In parts, so that making the data does not set the peak that is to be measured.
    parts = [measured(robot, truth, part, rng, noise_mm=NOISE_MM) for part in np.array_split(q, max(1, len(q) // 5000))]
    dataset = joined(parts, count)
    start_mb = peak_mb()
    began = time.process_time()
    fit = solve(make_residuals(residual, geometric_model(robot), Observations.of(dataset)))
    fit_s, fit_mb = time.process_time() - began, peak_mb()
    began = time.process_time()
    result = calibrate(dataset, FitOptions(residual))
    print(
        json.dumps(
            {
                "poses": count,
                "start_mb": start_mb,
                "fit_s": fit_s,
                "fit_mb": fit_mb,
                "all_s": time.process_time() - began,
                "all_mb": peak_mb(),
                "iterations": len(fit.iterations) - 1,
                "converged": fit.converged and result.fit.converged,
                "noise": fit.reduced_chi,
            }
        )
    )


def joined(parts: list, train: int):  # type: ignore[no-untyped-def]
    """Datasets of one arm as one; poses beyond the first `train` are for testing."""
    from dataclasses import replace

    from calib.dataset.dataset import Points, Poses

    q = np.concatenate([part.poses.q for part in parts])
    points = np.concatenate([part.points.xyz_mm for part in parts])
    count = len(q)
    ids = tuple(f"p{i:06d}" for i in range(count))
    role = np.array(["reference"] + ["train"] * (train - 1) + ["test"] * (count - train))
    poses = Poses(ids, role, q, np.full(count, ""), ids)
    return replace(parts[0], poses=poses, points=Points(np.arange(count), points, np.full(count, "jig")))


def exponent(rows: list[dict], key: str) -> str:
    """Slope of log time over log poses: over all counts, and over the last two, where the overhead is gone."""
    n, t = (np.log([row[k] for row in rows]) for k in ("poses", key))
    if len(rows) < 2:
        return "needs two counts"
    return f"{np.polyfit(n, t, 1)[0]:.2f} over all, {(t[-1] - t[-2]) / (n[-1] - n[-2]):.2f} over the last two"


def main() -> None:
    """Run each count, print the table and the exponents."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, nargs="+", default=[100, 1000, 10_000, 100_000])
    parser.add_argument("--limit-mb", type=float, default=1024.0)
    parser.add_argument("--residual", choices=("position", "distance", "pairs"), default="position")
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        child(arguments.child, arguments.residual)
        return
    head = (
        "poses", "solve, s", "calibrate, s", "ms/pose", "iterations", "before, MB", "fit, peak", "all, peak", "KB/pose",
    )  # fmt: skip
    print(" ".join(f"{h:>12}" for h in head))
    rows = []
    for count in arguments.poses:
        command = [sys.executable, __file__, "--child", str(count), "--residual", arguments.residual]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{count} poses: {done.stderr}")
        row = json.loads(done.stdout)
        rows.append(row)
        figures = (
            f"{row['poses']}", f"{row['fit_s']:.3f}", f"{row['all_s']:.3f}", f"{1e3 * row['all_s'] / count:.3f}",
            f"{row['iterations']}" + ("" if row["converged"] else "!"), f"{row['start_mb']:.0f}",
            f"{row['fit_mb']:.0f}", f"{row['all_mb']:.0f}", f"{1024 * (row['all_mb'] - row['start_mb']) / count:.1f}",
        )  # fmt: skip
        print(" ".join(f"{f:>12}" for f in figures), flush=True)
    print(f"time ~ poses^k, solve:     k = {exponent(rows, 'fit_s')}")
    print(f"time ~ poses^k, calibrate: k = {exponent(rows, 'all_s')}")
    last = rows[-1]
    verdict = "below" if last["all_mb"] < arguments.limit_mb else "ABOVE"
    print(f"{last['poses']} poses: peak {last['all_mb']:.0f} MB, {verdict} {arguments.limit_mb:.0f} MB")


if __name__ == "__main__":
    main()
