"""Calibrations by this project, pybotics and robotkinecal of the same data, on the same machine, in one run.

    python benchmarks/peers.py --cache DIR [--arms 2] [--panda DATASET] [--slow]
    python benchmarks/peers.py --pybotics PYTHON --robotkinecal PYTHON ...

With --cache, each peer gets a virtual environment of its own in DIR, from PyPI; else name interpreters that have them.

Simulated: UR10s whose 24 modified DH parameters and tool point are off by 0.3 mm and 0.1 deg, 50 random poses, measured
in the base frame, so that every tool's model can meet them exactly; and, in a third table, with joint frames that lean
about y too, as real ones do. The error is that of 500 other poses against the truth. Ours runs with its defaults and is
not told where the base is: 35 parameters and 6 of the scanner's place against the others' 27; "without beta" knows what
modified DH takes for granted. Seconds are the processor's, which other work on the machine does not lengthen, for the
fit in a process that runs already, one thread; "calibrate" adds the evaluation of every iteration.

Real, with --panda: a dataset with several setups; its test poses lie in a place of their own, whose frame is fitted to
them for everyone. The peers know a single base frame; what is wrapped around them is told in `peer_worker.py`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from simulated import NOISE_MM, Array, random_q, rms_3d, ur10  # isort: skip  (sets the paths)
from peer_worker import along, mdh_of, spin

from calib import calibrate, frames
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.folder import load_dataset
from calib.fitting.model import geometric_model
from calib.fitting.observations import Observations
from calib.fitting.position_residuals import PositionResiduals
from calib.fitting.trust_region import solve
from calib.kinematics.robot import Robot, Tool

WORKER = Path(__file__).with_name("peer_worker.py")
# The tool's point lies off the last axis, as robotkinecal's documentation asks.
ARM = ur10(Tool(a_mm=60.0, d_mm=100.0, theta_rad=0.5))


@dataclass(frozen=True)
class Problem:
    """Input of every tool: nominal DH rows a, alpha, d, theta; joints, points, each point's setup or none."""

    table: Array
    q: Array
    points: Array
    setup: Array
    q_test: Array


@dataclass(frozen=True)
class Answer:
    """Predicted points, mm, base frame; seconds; parameters; what the tool says of its way."""

    train: Array
    test: Array
    seconds: float
    parameters: int
    note: str


def peer(python: Path, name: str, problem: Problem) -> Answer:
    """Result of a calibration in the peer's own environment."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "problem.npz", Path(folder) / "answer.npz"
        np.savez(given, **vars(problem))
        done = subprocess.run(
            [str(python), str(WORKER), name, str(given), str(found)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            sys.exit(f"{name} failed:\n{done.stderr}")
        with np.load(found) as answer:
            return Answer(
                answer["train"],
                answer["test"],
                float(answer["seconds"]),
                int(answer["parameters"]),
                str(answer["note"]),
            )


def environment(cache: Path, package: str) -> Path:
    """The interpreter of a virtual environment that has the package; made at the first call."""
    folder = cache / package
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    has = subprocess.run([str(python), "-c", f"import {package}"], capture_output=True, check=False)
    if has.returncode:
        done = subprocess.run(
            [str(python), "-m", "pip", "install", "-q", package], capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit(f"{package} does not install:\n{done.stderr[-2000:]}")
    return python


# ---------------------------------------------------------------- simulated UR10


def dh_rows(robot: Robot) -> Array:
    """(n + 1, 4) a, alpha, d, theta, the peers' parameters of a link."""
    return robot.table[:, :4]


def mdh_points(mdh: Array, tilt: Array, tool: Array, q: Array) -> Array:
    """Tool points by multiplying transforms one by one; `tilt` turns each joint's frame about y first."""
    out = []
    for joints in q:
        at = np.eye(4)
        for (alpha, a, theta, d), lean, value in zip(mdh, tilt, joints, strict=True):
            at = at @ along(a, alpha) @ about_y(lean) @ spin(theta + value, d)
        out.append((at @ tool)[:3, 3])
    return np.array(out)


def ours(problem: Problem) -> dict[str, Answer]:
    """The fit alone, as the others do it; `calibrate`, which evaluates it too; a fit without beta. Best of three."""
    count = len(problem.q)
    dataset = Dataset(
        "ur10",
        ARM,
        poses_of(problem.q, ["reference"] + ["train"] * (count - 1)),
        Points(np.arange(count), problem.points, np.full(count, "jig")),
        scanner=Scanner(NOISE_MM),
    )
    observed = Observations.of(dataset)
    model = geometric_model(dataset.robot)
    no_beta = model.with_fixed([name for name in dataset.robot.parameter_names if name.startswith("beta")])
    runs: dict[str, Callable[[], object]] = {
        "ours: solve": lambda: solve(PositionResiduals(model, observed)),
        "ours: calibrate": lambda: calibrate(dataset),
        "ours: without beta": lambda: solve(PositionResiduals(no_beta, observed)),
    }
    out = {}
    for name, run in runs.items():
        of = no_beta if run is runs["ours: without beta"] else model
        fit = solve(PositionResiduals(of, observed))
        assert fit.converged, fit.reason
        place = PositionResiduals(of, observed).scanner_frames(fit.x)[""]
        train, test = (
            frames.apply(place, of.predict(fit.x, poses_of(q, ["test"] * len(q)))) for q in (problem.q, problem.q_test)
        )
        note = f"{len(fit.iterations) - 1} iterations: {fit.reason}"
        out[name] = Answer(train, test, min(seconds_of(run) for _ in range(3)), len(fit.x) + 6, note)
    return out


def seconds_of(run: Callable[[], object]) -> float:
    """Processor time of one call."""
    began = time.process_time()
    run()
    return time.process_time() - began


def about_y(angle: float) -> Array:
    """Ry(angle)"""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])


def poses_of(q: Array, roles: list[str]) -> Poses:
    """Joint vectors as poses of one setup."""
    ids = tuple(f"p{i:03d}" for i in range(len(q)))
    return Poses(ids, np.array(roles), q, np.full(len(q), ""), ids)


VARIANTS = ("pybotics:documented", "pybotics:scaled", "robotkinecal:m", "robotkinecal:mm")
SLOW = ("pybotics:vector", "pybotics:tight")


def simulated(arms: int, interpreters: dict[str, Path], *, slow: bool) -> None:
    """The UR10s: without noise, with noise, and with axes off in every direction, which modified DH cannot say."""
    for noise_mm, every_way in ((0.0, False), (NOISE_MM, False), (NOISE_MM, True)):
        rows: dict[str, list[tuple[float, float, Answer]]] = {}
        nominal = []
        for k in range(arms):
            problem, before, truth = one_arm(np.random.default_rng([11, k]), noise_mm, every_way)
            nominal.append(rms_3d(before - truth))
            answers = ours(problem)
            for name in (*VARIANTS, *SLOW) if slow else VARIANTS:
                if every_way and name == "pybotics:scaled" and not slow:
                    continue  # a minute an arm, towards a minimum that its model cannot reach
                answers[name] = peer(interpreters[name.split(":")[0]], name, problem)
            for name, answer in answers.items():
                row = (rms_3d(answer.train - problem.points), rms_3d(answer.test - truth), answer)
                rows.setdefault(name, []).append(row)
        how = "axes off in every direction" if every_way else "modified DH holds the truth"
        print(
            f"\nUR10, 50 poses, {noise_mm:g} mm noise, {how}; {arms} arms, nominal {np.median(nominal):.2f} mm; medians"
        )
        table(rows)


def one_arm(rng: np.random.Generator, noise_mm: float, every_way: bool) -> tuple[Problem, Array, Array]:
    """Measurements of one arm, and 500 other poses by the nominal and by the true arm."""
    mdh, tool = mdh_of(dh_rows(ARM))
    tilt = np.radians(0.1) * rng.standard_normal(len(mdh))
    off = rng.standard_normal(mdh.shape) * np.array([np.radians(0.1), 0.3, np.radians(0.1), 0.3])
    true_tool = tool.copy()
    true_tool[:3, 3] += 0.3 * rng.standard_normal(3)
    q, q_test = random_q(ARM, 50, rng), random_q(ARM, 500, rng)
    tilt = tilt if every_way else np.zeros(len(mdh))
    points = mdh_points(mdh + off, tilt, true_tool, q) + noise_mm * rng.standard_normal((50, 3))
    problem = Problem(dh_rows(ARM), q, points, np.array([], dtype=str), q_test)
    nominal = mdh_points(mdh, np.zeros(len(mdh)), tool, q_test)
    return problem, nominal, mdh_points(mdh + off, tilt, true_tool, q_test)


def table(rows: dict[str, list[tuple[float, float, Answer]]]) -> None:
    """Errors and times of all, the first being ours, and the others' over ours."""
    head = ("parameters", "training, mm", "held out, mm", "over ours", "seconds", "over ours")
    print(f"{'':20} " + " ".join(f"{h:>12}" for h in head))
    _, ours_mm, ours_s = medians(next(iter(rows.values())))
    for name, runs in rows.items():
        train, test, seconds = medians(runs)
        figures = (
            f"{runs[0][2].parameters}", f"{train:.3g}", f"{test:.3g}", f"{test / ours_mm:.3g}", f"{seconds:.4f}",
            f"{seconds / ours_s:.1f}",
        )  # fmt: skip
        print(f"{name:20} " + " ".join(f"{f:>12}" for f in figures) + f"   {runs[0][2].note}", flush=True)


def medians(runs: list[tuple[float, float, Answer]]) -> tuple[float, float, float]:
    """Training error, held-out error, seconds."""
    train, test, seconds = zip(*((a, b, answer.seconds) for a, b, answer in runs), strict=True)
    return float(np.median(train)), float(np.median(test)), float(np.median(seconds))


# ---------------------------------------------------------------- a real arm


def real(path: Path, interpreters: dict[str, Path], *, slow: bool) -> None:
    """A dataset with several setups, its test poses in a place of their own."""
    dataset = load_dataset(path)
    assert dataset.points is not None
    result = calibrate(dataset)
    seconds = min(seconds_of(lambda: calibrate(dataset)) for _ in range(3))
    residuals = PositionResiduals(result.model, Observations.of(dataset))
    fit_s = min(seconds_of(lambda: solve(residuals)) for _ in range(3))
    robot, poses, points = dataset.robot, dataset.poses, dataset.points
    test = poses.is_test[points.pose]
    q, setup = poses.q[points.pose], poses.setup[points.pose]
    train_of = Problem(dh_rows(robot), q[~test], points.xyz_mm[~test], setup[~test].astype(str), q[test])
    assert np.all(robot.table[:, 4] == 0.0), "the peers know no beta"
    assert result.after.train is not None
    assert result.after.test is not None
    assert result.before.test is not None
    parameters = len(result.fit.x) + 6 * len(np.unique(setup[~test]))
    rows = {
        name: [
            (
                result.after.train.rmse_mm,
                result.after.test.rmse_mm,
                Answer(q, q, took, parameters, result.fit.reason),
            )
        ]
        for name, took in (("ours: solve", fit_s), ("ours: calibrate", seconds))
    }
    names = ("robotkinecal:m", "robotkinecal:mm", "pybotics:documented", "pybotics:scaled")
    for name in names if slow else names[:2]:
        answer = peer(interpreters[name.split(":")[0]], name, train_of)
        train_mm = placed_rmse(answer.train, train_of.points, train_of.setup)
        rows[name] = [(train_mm, placed_rmse(answer.test, points.xyz_mm[test], setup[test]), answer)]
    print(
        f"\n{dataset.name}: {np.sum(~test)} training points in {len(np.unique(setup[~test]))} places, "
        f"{np.sum(test)} in a place held out; nominal {result.before.test.rmse_mm:.2f} mm"
    )
    table(rows)


def placed_rmse(base_mm: Array, measured_mm: Array, setup: Array) -> float:
    """3D RMSE with each setup's frame fitted to its own points, as `evaluate` does for a place without training."""
    error = []
    for name in np.unique(setup):
        rows = setup == name
        place = frames.best_fit_transform(base_mm[rows], measured_mm[rows])
        error.append(frames.apply(place, base_mm[rows]) - measured_mm[rows])
    return rms_3d(np.concatenate(error))


def main() -> None:
    """Find or make the environments, then the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, help="where the peers' environments are, or are made")
    parser.add_argument("--pybotics", type=Path, help="an interpreter that has pybotics")
    parser.add_argument("--robotkinecal", type=Path, help="an interpreter that has robotkinecal")
    parser.add_argument("--arms", type=int, default=2)
    parser.add_argument("--panda", type=Path, help="a dataset folder, e.g. a real Panda")
    parser.add_argument("--slow", action="store_true", help="further settings of pybotics; minutes each")
    arguments = parser.parse_args()
    interpreters = {}
    for package in ("pybotics", "robotkinecal"):
        given = getattr(arguments, package)
        if given is None and arguments.cache is None:
            parser.error(f"give --cache DIR, or --{package} PYTHON")
        interpreters[package] = given or environment(arguments.cache.resolve(), package)
    if arguments.arms:
        simulated(arguments.arms, interpreters, slow=arguments.slow)
    if arguments.panda:
        real(arguments.panda, interpreters, slow=arguments.slow)


if __name__ == "__main__":
    main()
