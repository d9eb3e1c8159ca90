"""Planned poses beside random ones, and what a plan predicts beside what simulated arms then have.

Arms and measurements come from `calib.simulation.truth`, which shares no code with planning or fits. Held-out errors
are of the model's places (3D RMS, mm, without noise) at poses that can be measured, neither fitted nor planned with.

- sets: 20 planned poses beside 20 and 27 random ones of those that can be measured, median of the arms; and what peers
  choose from the same candidates: Fedorov's exchange for D.
- prediction: the error that the plan predicts over that of many arms, and how many lie in its band of 90 %.
- jang: sample_data/rb5_jang and 5 poses more, predicted, and simulated with its own noise.
- time: of a whole plan, one core.

    python benchmarks/planning.py [--arms N] [--many N] [--only sets|prediction|jang|time]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: one thread

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, find_corners
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import effects_named
from calib.kinematics.robot import Joint, Robot
from calib.measurement.measured_points import with_corners
from calib.planning.exchange import OptimalityCriterion, best_poses, inverse
from calib.planning.plan import Plan, plan_poses
from calib.planning.start import FromFit, FromRobot, start_of_dataset
from calib.simulation.truth.arm_sampling import TYPICAL, Tolerances, draw_truth
from calib.simulation.truth.equilibrium import Truth, scanner_T_target
from calib.simulation.truth.mechanism import Conditions
from calib.statistics import rms
from calib.workcell.candidates import candidate_poses
from calib.workcell.known_cell import workcell_of_robot
from calib.workcell.workcell import Workcell
from tests.support.engine.arms import GANTRY, UR10E, ArmTable

ROOT = Path(__file__).resolve().parents[1]
NOISE_MM = 0.05
HELD_OUT = 200
AS_TOLERATED = Tolerances(1.0, 0.5)  # the prior's own

Array = NDArray[np.float64]


def cells() -> dict[str, Workcell]:
    """Four makes, each with Jang's jig and scanner, which stands where `workcell_of_robot` puts it."""
    robots = {
        "RB5": builtin_robot("rb5"),
        "Panda": builtin_robot("panda"),
        "UR10e": engine_robot(UR10E),
        "gantry": engine_robot(GANTRY),
    }
    return {name: workcell_of_robot(robot) for name, robot in robots.items()}


def engine_robot(arm: ArmTable) -> Robot:
    """An arm of the tests' second engine, as its maker's table has it, without a tool."""
    joints = tuple(
        Joint(*row, name=f"J{j + 1}", type="prismatic" if slides else "revolute", min=low, max=high)
        for j, (row, slides, low, high) in enumerate(zip(arm.rows, arm.slides, arm.low, arm.high, strict=False))
    )
    return Robot(arm.name, joints)


def measured(robot: Robot, truth: Truth, q: Array, rng: np.random.Generator, held_out: Array) -> Dataset:
    """The training poses q (N, n) with noise, and test poses without."""
    every = np.concatenate([q, held_out])
    role = np.array(["reference", *["train"] * (len(q) - 1), *["test"] * len(held_out)])
    ids = tuple(f"p{k + 1:03d}" for k in range(len(every)))
    poses = Poses(ids, role, every, np.full(len(every), ""), ids)
    seen = scanner_T_target(truth, every, Conditions.of(poses))[:, :3, 3]
    seen[: len(q)] += NOISE_MM * rng.standard_normal((len(q), 3))
    points = Points(np.arange(len(every)), seen, np.full(len(every), "jig"))
    return Dataset(robot.name, robot, poses, points, scanner=Scanner(point_sigma_mm=NOISE_MM))


def realised_mm(dataset: Dataset) -> float:
    """The model's held-out error after a fit."""
    test = calibrate(dataset).after.test
    assert test is not None
    return test.rmse_mm


class Volume(OptimalityCriterion):
    """The measure of D-optimal poses: the determinant of the target combinations' covariance."""

    def log_value(self, information: Array) -> float:
        return float(np.linalg.slogdet(self.target_combinations.T @ inverse(information) @ self.target_combinations)[1])

    def log_values_with(self, information: Array) -> Array:
        return np.array([self.log_value(information + rows.T @ rows) for rows in self.rows])


def d_optimal(plan: Plan, count: int) -> Array:
    """D-optimal poses of the same candidates as the plan's, by exchange (Fedorov)."""
    robot_start = plan.start
    offered = robot_start.poses_at(candidates_of(robot_start, 800))
    unknowns = robot_start.unknowns()
    question = Volume(unknowns.rows(offered), unknowns.prior_information, unknowns.of_parameters())
    return offered.q[best_poses([question], count).rows]


def candidates_of(start: FromFit | FromRobot, count: int) -> Array:
    """Candidate poses drawn as `plan_poses` draws them."""
    return candidate_poses(start.cell, count, rng=np.random.default_rng(0))


def sets(arms: int, tolerances: Tolerances) -> None:
    """Print the errors of planned sets of poses beside random ones."""
    errors_of = f"{tolerances.length_mm} mm, {tolerances.angle_deg} deg"
    print(f"sets: held-out error, mm, median of {arms} arms with errors of {errors_of}")
    print(f"{'arm':8s} planned 20  random 20  random 27  Fedorov D 20   planned 20 <= random 27 in")
    for name, cell in cells().items():
        start = FromRobot(cell, NOISE_MM)
        plan = plan_poses(start, 20)
        many = candidate_poses(start.cell, 47 * 10 + HELD_OUT, rng=np.random.default_rng(1))
        held_out, many = many[:HELD_OUT], many[HELD_OUT:]
        chosen = {
            "planned": plan.poses.q,
            "fedorov": d_optimal(plan, 20),
        }
        found: dict[str, list[float]] = {}
        for seed in range(arms):
            at = np.random.default_rng(seed).permutation(len(many))
            chosen |= {"random 20": many[at[:20]], "random 27": many[at[20:47]]}
            truth = drawn_truth(start, held_out, seed, tolerances)
            for kind, q in chosen.items():
                rng = np.random.default_rng(1000 + seed)
                found.setdefault(kind, []).append(realised_mm(measured(cell.robot, truth, q, rng, held_out)))
        middle = {kind: float(np.median(errors)) for kind, errors in found.items()}
        wins = int(np.sum(np.array(found["planned"]) <= np.array(found["random 27"])))
        print(
            f"{name:8s} {middle['planned']:10.4f} {middle['random 20']:10.4f} {middle['random 27']:10.4f} "
            f"{middle['fedorov']:13.4f}   {wins} of {arms}"
        )


def drawn_truth(start: FromRobot, q: Array, seed: int, tolerances: Tolerances) -> Truth:
    """An arm with link errors."""
    assert start.cell.base_T_scanner is not None
    rng = np.random.default_rng(seed)
    return draw_truth(start.cell.robot, start.cell.base_T_scanner, q, rng=rng, tolerances=tolerances)


def prediction(many: int, tolerances: Tolerances) -> None:
    """Print predicted over realised errors."""
    errors_of = f"{tolerances.length_mm} mm, {tolerances.angle_deg} deg"
    print(f"prediction: 20 planned poses, {many} arms with errors of {errors_of}")
    for name, cell in cells().items():
        start = FromRobot(cell, NOISE_MM)
        plan = plan_poses(start, 20)
        held_out = candidate_poses(start.cell, HELD_OUT, rng=np.random.default_rng(1))
        errors = []
        for seed in range(many):
            truth = drawn_truth(start, held_out, seed, tolerances)
            rng = np.random.default_rng(1000 + seed)
            errors.append(realised_mm(measured(cell.robot, truth, plan.poses.q, rng, held_out)))
        rms = float(np.sqrt(np.mean(np.square(errors))))
        then, at = plan.then, np.array(errors)
        inside = float(np.mean((at > then.low_mm) & (at < then.high_mm)))
        print(
            f"{name:8s} predicted {then.geometry_mm:.4f}, realised {rms:.4f}, ratio {then.geometry_mm / rms:.3f}; "
            f"{100 * inside:.0f} % within {then.low_mm:.4f} to {then.high_mm:.4f}"
        )


def jang(many: int) -> None:
    """Print the errors of the sample arm with five poses more."""
    dataset = load_dataset(ROOT / "sample_data" / "rb5_jang")
    dataset = with_corners(dataset, find_corners(dataset, intermediate=False))
    fit = calibrate(dataset)
    for words, start in (
        ("link errors alone", FromFit(fit)),
        ("with joint_compliance, as the diagnosis has it", start_of_dataset(dataset, fit.options)),
    ):
        began = time.process_time()
        plan = plan_poses(start, 5)
        took = time.process_time() - began
        errors = [simulated(start, further, many) for further in (None, plan.poses.q)]
        now, then = (rms(e) for e in errors)
        now_middle, then_middle = (float(np.median(e)) for e in errors)
        far = int(np.sum(errors[1] > 4.0 * plan.then.geometry_mm))
        print(
            f"jang, {words}: at {plan.region} predicted {plan.now.geometry_mm:.4f} -> {plan.then.geometry_mm:.4f} mm, "
            f"simulated ({many} arms) {now:.4f} -> {then:.4f}, median {now_middle:.4f} -> {then_middle:.4f}, "
            f"{far} more than four times the prediction; {took:.2f} s"
        )


def simulated(start: FromFit, further: Array | None, many: int) -> Array:
    """(many,) held-out errors of arms like the fitted one, measured at its poses and further ones with its noise."""
    calibration = start.calibration
    dataset, points = calibration.fitted_dataset, calibration.fitted_dataset.points
    assert points is not None
    assert points.covariance_mm2 is not None
    poses = dataset.poses
    trained = points.pose[~poses.is_test[points.pose]]
    test = np.flatnonzero(poses.is_test)
    q = np.concatenate([poses.q[trained], *([] if further is None else [further])])
    covariance = calibration.fit.reduced_chi**2 * np.concatenate(
        [
            points.covariance_mm2[~poses.is_test[points.pose]],
            *([] if further is None else [np.tile(points.covariance_mm2.mean(axis=0), (len(further), 1, 1))]),
        ]
    )
    root = np.linalg.cholesky(covariance)
    place = start.cell.base_T_scanner
    assert place is not None
    wanted = ("joint_compliance",) if calibration.model.added_effects else ()
    errors = []
    for seed in range(many):
        rng = np.random.default_rng(seed)
        truth = draw_truth(dataset.robot, place, q, rng=rng, effects=wanted)
        made = measured(dataset.robot, truth, q, rng, poses.q[test])
        assert made.points is not None
        exact = scanner_T_target(truth, made.poses.q, Conditions.of(made.poses))[:, :3, 3]
        xyz_mm = exact.copy()
        xyz_mm[: len(q)] += np.einsum("nij,nj->ni", root, rng.standard_normal((len(q), 3)))
        every = np.concatenate([covariance, np.tile(covariance.mean(axis=0), (len(test), 1, 1))])
        made = replace(made, points=replace(made.points, xyz_mm=xyz_mm, covariance_mm2=every))
        effects = effects_named(made, wanted)
        chosen = [m for m in effects if m in calibration.model.effects] if wanted else []
        error = calibrate(made, calibration.options, effects=chosen).after.test
        assert error is not None
        errors.append(error.rmse_mm)
    return np.array(errors)


def times() -> None:
    """Print the time of a whole plan, with the cell and its candidates."""
    for name, cell in cells().items():
        began = time.process_time()
        plan_poses(FromRobot(cell, NOISE_MM), 20)
        print(f"time: 20 poses for {name}: {time.process_time() - began:.2f} s of one core")


def main() -> None:
    """Print all of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=20, help="of each make, for sets (default 20)")
    parser.add_argument("--many", type=int, default=100, help="arms for predictions (default 100)")
    parser.add_argument("--only", choices=("sets", "prediction", "jang", "time"))
    asked = parser.parse_args()
    if asked.only in (None, "time"):
        times()
    if asked.only in (None, "sets"):
        for tolerances in (TYPICAL, AS_TOLERATED):
            sets(asked.arms, tolerances)
    if asked.only in (None, "prediction"):
        for tolerances in (TYPICAL, AS_TOLERATED):
            prediction(asked.many, tolerances)
    if asked.only in (None, "jang"):
        jang(asked.many)


if __name__ == "__main__":
    main()
