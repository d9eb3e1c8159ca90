"""The solver on many random robots, beside the bounds and beside the plain iteration of the papers.

    python benchmarks/solver.py [exact] [missing] [sigmas] [pairs] [--robots 200]

exact    noise-free, Park 2022's set-up: how far, how fast, how surely
missing  0.05 mm noise and joints that yield by 1e-4 rad/Nm, which the model does not know: does anything diverge
sigmas   are the sigmas true, and is the error at the Cramer-Rao bound
pairs    Park's pairwise redundancy against the rank: RB5, Panda, UR10, a SCARA

Robot k of a part is the same at any count. `--robots 1000` for exact and missing and `--robots 500` for sigmas are what
the README quotes.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from simulated import (  # isort: skip  (sets the paths)
    NOISE_MM,
    Array,
    anywhere,
    heavy_arm,
    measured,
    mixed_arm,
    off_by,
    random_q,
    scara,
    ur10,
)
from arms import park_arm
from calib import kinematics
from calib.dataset import Dataset
from calib.evaluation import evaluate
from calib.model import Model, geometric_model
from calib.observations import Observations
from calib.redundancy import analyse
from calib.residuals import PositionResiduals, make_residuals
from calib.robot import Robot
from calib.solver import Fit, solve
from calib.truth import Truth

EPS = float(np.finfo(float).eps)


# ---------------------------------------------------------------- exact data


def spread(values: Array) -> str:
    """Median, 99th percentile and worst."""
    return f"{np.median(values):9.1e} {np.quantile(values, 0.99):9.1e} {np.max(values):9.1e}"


def distance_rms_mm(model: Model, x: Array, dataset: Dataset) -> float:
    """RMS error of the distances to the first pose."""
    assert dataset.points is not None
    base_mm, seen_mm = model.predict(x, dataset.poses), dataset.points.xyz_mm
    error = np.linalg.norm(base_mm[1:] - base_mm[0], axis=1) - np.linalg.norm(
        seen_mm[1:] - seen_mm[0], axis=1
    )
    return float(np.sqrt(np.mean(error**2)))


def exact(count: int) -> None:
    """Park's set-up: 64 random poses, errors of 1 mm and 3 mrad everywhere, no noise."""
    cases = (
        ("positions, base known", False),
        ("positions, free scanner", False),
        ("positions, free, prior", True),
        ("distances", False),
    )
    rmse: dict[str, list[float]] = {name: [] for name, _ in cases}
    fits: dict[str, list[Fit]] = {name: [] for name, _ in cases}
    floor = []
    for k in range(count):
        rng = np.random.default_rng([1, k])
        _, robot = mixed_arm(k, rng)
        true = off_by(robot, rng, mm=1.0, rad=0.003)
        q = random_q(robot, 64, rng)
        here = measured(robot, Truth.without_effects(true, np.eye(4)), q, rng, noise_mm=0.0)
        there = measured(robot, Truth.without_effects(true, anywhere(rng)), q, rng, noise_mm=0.0)
        assert here.points is not None
        floor.append(rms_3d(kinematics.target_points(true, q) - here.points.xyz_mm))
        model = geometric_model(robot)
        for name, prior in cases:
            known = name == "positions, base known"
            dataset = here if known else there
            observed = Observations.of(dataset)
            residuals = (
                make_residuals("distance", model, observed)
                if name == "distances"
                else PositionResiduals(model, observed, frame_known=known)
            )
            fit = solve(residuals, prior=prior)
            fits[name].append(fit)
            rmse[name].append(
                distance_rms_mm(model, fit.x, dataset)
                if name == "distances"
                else NOISE_MM * float(np.sqrt(3 * fit.iterations[-1].cost / fit.rows))
            )
    print(
        f"\nExact data, {count} random robots: RB5, Panda, random arms of 5, 6, 7 joints, {count // 5} each"
    )
    print(
        f"{'':26} {'converged':>11} {'diverged':>9}   RMSE mm: median      99 %     worst   iterations: how many robots"
    )
    for name, _ in cases:
        steps = Counter(len(fit.iterations) - 1 for fit in fits[name])
        worse = sum(not fit.iterations[-1].cost < fit.iterations[0].cost for fit in fits[name])
        print(
            f"{name:26} {sum(f.converged for f in fits[name]):5} /{count:5} {worse:9}           "
            f"{spread(np.array(rmse[name]))}   {', '.join(f'{s}: {n}' for s, n in sorted(steps.items()))}"
        )
    print(f"{'rounding: two codes, truth':48}           {spread(np.array(floor))}")
    print(f"{'paper, best of five cases':48}             1.9e-13 .. 2.5e-13           300 .. 1000 iterations")


def rms_3d(error_mm: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(error_mm**2, axis=-1))))


# ---------------------------------------------------------------- a strong effect missing


@dataclass(frozen=True)
class Outcome:
    """How a fit, or the plain iteration, ended: training cost and held-out RMSE, each over its start."""

    cost: float
    held_out: float
    converged: bool = True
    largest: float = 1.0  # the largest cost on the way, over the start's


def missing(count: int) -> None:
    """64 poses, 13 held out, 0.05 mm noise, joints of 1e-4 rad/Nm: ours by both residuals, the plain step beside."""
    names = ("ours, positions", "ours, distances", "plain, positions", "plain, distances (eq 16)")
    outcomes: dict[str, list[Outcome]] = {name: [] for name in names}
    nominal_mm, found_mm = [], []
    for k in range(count):
        rng = np.random.default_rng([2, k])
        _, robot = heavy_arm(k, rng)
        truth = Truth.without_effects(off_by(robot, rng, mm=0.3, rad=np.radians(0.1)), anywhere(rng))
        truth = replace(truth, joint_compliance_rad_per_nm=np.full(robot.n_joints, 1e-4))
        dataset = measured(robot, truth, random_q(robot, 64, rng), rng, noise_mm=NOISE_MM, test=13)
        model, observed = geometric_model(robot), Observations.of(dataset)
        nominal = held_out_mm(model, np.zeros(len(model.parameters)), dataset)
        for kind in ("position", "distance"):
            fit = solve(make_residuals(kind, model, observed))
            after = held_out_mm(model, fit.x, dataset)
            costs = [i.cost / fit.iterations[0].cost for i in fit.iterations]
            outcomes[f"ours, {kind}s"].append(Outcome(costs[-1], after / nominal, fit.converged, max(costs)))
            if kind == "position":
                nominal_mm.append(nominal)
                found_mm.append(after)
        outcomes[names[2]].append(plain(*plain_positions(model, observed), model, dataset, nominal))
        outcomes[names[3]].append(plain(*plain_distances(model, observed), model, dataset, nominal))
    print(
        f"\nJoint compliance of 1e-4 rad/Nm missing from the model, {NOISE_MM} mm noise, {count} random robots"
    )
    print(
        f"{'':26} {'converged':>10} {'training cost':>14} {'blew up':>9} {'held-out':>9}   held-out RMSE over nominal's"
    )
    print(
        f"{'':26} {'':>10} {'got worse':>14} {'(x100)':>9} {'worse':>9}   {'median':>9} {'99 %':>9} {'worst':>9}"
    )
    for name, all_of in outcomes.items():
        print(
            f"{name:26} {sum(o.converged for o in all_of) if name.startswith('ours') else '-':>10} "
            f"{sum(not o.cost < 1.0 for o in all_of):>14} {sum(not o.largest < 100.0 for o in all_of):>9} "
            f"{sum(not o.held_out < 1.0 for o in all_of):>9}   {spread(np.array([o.held_out for o in all_of]))}"
        )
    print(
        f"held-out RMSE, median robot: nominal {np.median(nominal_mm):.2f} mm, ours by positions "
        f"{np.median(found_mm):.2f} mm; largest nominal {max(nominal_mm):.1f} mm"
    )
    print(
        "plain: x <- x - J^+ r, 20 times, mm and rad as they are; no damping, no prior; J^+ drops s < max(J.shape) eps s1"
    )


def held_out_mm(model: Model, x: Array, dataset: Dataset) -> float:
    with np.errstate(all="ignore"):
        try:
            figures = evaluate(model, x, dataset).test
        except (np.linalg.LinAlgError, ValueError):
            return np.inf
    assert figures is not None
    return figures.rmse_mm if np.isfinite(figures.rmse_mm) else np.inf


def plain(linearise, cost, model: Model, dataset: Dataset, nominal_mm: float) -> Outcome:  # type: ignore[no-untyped-def]
    """Jang eq (16): the pseudo-inverse step again and again."""
    x = np.zeros(len(model.parameters))
    start, largest = cost(x), 1.0
    with np.errstate(all="ignore"):
        for _ in range(20):
            residual, jacobian = linearise(x)
            try:
                x = x - np.linalg.pinv(jacobian, rcond=max(jacobian.shape) * EPS) @ residual
            except np.linalg.LinAlgError:
                return Outcome(np.inf, np.inf, largest=np.inf)
            share = cost(x) / start
            largest = max(largest, share) if np.isfinite(share) else np.inf
    return Outcome(share, held_out_mm(model, x, dataset) / nominal_mm, largest=largest)


def plain_positions(model: Model, observed: Observations):  # type: ignore[no-untyped-def]
    residuals = PositionResiduals(model, observed)

    def linearise(x: Array) -> tuple[Array, Array]:
        at = residuals.linearise(x)
        return at.residual, at.jacobian

    return linearise, lambda x: float(np.sum(residuals.residual(x) ** 2))


def plain_distances(model: Model, observed: Observations):  # type: ignore[no-untyped-def]
    """Jang eq (14): rows L_N^2 - L_M^2 and 2 (P_k - P_1)^T (J_k - J_1)."""
    poses, _ = observed.used_poses
    seen_mm = observed.points.xyz_mm
    square = np.sum((seen_mm[1:] - seen_mm[0]) ** 2, axis=1)

    def linearise(x: Array) -> tuple[Array, Array]:
        base_mm, by_x = model.linearise(x, poses)
        along = base_mm[1:] - base_mm[0]
        return np.sum(along**2, axis=1) - square, 2.0 * np.einsum("ki,kip->kp", along, by_x[1:] - by_x[0])

    def cost(x: Array) -> float:
        along = model.predict(x, poses)
        length = np.linalg.norm(along[1:] - along[0], axis=1)
        return float(np.sum((length - np.sqrt(square)) ** 2))

    return linearise, cost


# ---------------------------------------------------------------- sigmas and the bound


def sigmas(count: int) -> None:
    """Normalised errors of what the data know, the error against the bound, and the predictions' error against theirs."""
    print(
        f"\nHonest sigmas and the Cramer-Rao bound, {count} robots a row, 64 poses, free scanner, {NOISE_MM} mm noise"
    )
    print(
        f"{'':34} {'combinations':>13} {'variance of normalised':>23} {'RMS error over':>15} "
        f"{'predicted point, RMS':>21}"
    )
    print(
        f"{'':34} {'a robot':>13} {'errors (1.0 +- 0.05)':>23} {'the bound':>15} {'error over the bound':>21}"
    )
    for label, prior, independent in (
        ("prior off, independent parameters", False, True),
        ("prior off, all parameters", False, False),
        ("prior on, truths from the prior", True, False),
    ):
        results = [one_sigma(k, prior=prior, independent=independent) for k in range(count)]
        normalised = np.concatenate([r[0] for r in results])
        bound = np.concatenate([r[1] for r in results])
        predicted = np.array([r[2] for r in results])
        print(
            f"{label:34} {len(bound) / count:13.1f} {np.mean(normalised**2):14.3f} +- "
            f"{np.sqrt(2 / len(normalised)):.3f} {np.sqrt(np.mean(bound**2)):17.4f} {np.sqrt(np.mean(predicted)):21.4f}"
        )


def one_sigma(k: int, *, prior: bool, independent: bool) -> tuple[Array, Array, float]:
    """Errors by the fit's sigmas, by the bound's, and mean squared error of predictions over the bound's."""
    rng = np.random.default_rng([3, k])
    _, robot = mixed_arm(k, rng)
    model = geometric_model(robot)
    q = random_q(robot, 64, rng)
    if independent:
        names, units = robot.parameter_names, robot.parameter_units
        here = observed_of(robot, robot, q, np.eye(4), rng, 0.0)
        columns = PositionResiduals(model, here).linearise(np.zeros(len(names))).jacobian
        model = model.hold([n for n in names if n not in analyse(columns, names, units).independent])
    # A prior is believed only where truths follow it; without one, errors are those of a good factory.
    scale = model.scales if prior else model.scales * 0.2
    x_true = scale * rng.standard_normal(len(scale))
    observed = observed_of(robot, model.calibrated_robot(x_true), q, anywhere(rng), rng, NOISE_MM)
    residuals = PositionResiduals(model, observed)
    fit = solve(residuals, prior=prior)
    assert fit.converged, fit.reason

    scales = model.scales
    jacobian = residuals.linearise(x_true).jacobian * scales
    _, s, vt = np.linalg.svd(jacobian, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(vt) - len(s))])
    information = s**2 + (1.0 if prior else 0.0)
    knows = s > 1.0  # the data say more about it than its tolerance does
    error = vt @ ((fit.x - x_true) / scales)
    covariance = fit.covariance / np.outer(scales, scales)
    own = np.sqrt(np.einsum("kp,pq,kq->k", vt, covariance, vt))

    fresh = random_q(robot, 100, rng)
    new = observed_of(robot, model.calibrated_robot(x_true), fresh, np.eye(4), rng, 0.0)
    by = PositionResiduals(model, new).linearise(x_true).jacobian * scales @ vt[knows].T
    off = PositionResiduals(model, new).residual(fit.x)
    least = float(np.sum(by**2 / information[knows]))
    return error[knows] / own[knows], error[knows] * np.sqrt(information[knows]), float(off @ off) / least


def observed_of(
    robot: Robot, true: Robot, q: Array, place: Array, rng: np.random.Generator, noise_mm: float
) -> Observations:
    return Observations.of(measured(robot, Truth.without_effects(true, place), q, rng, noise_mm=noise_mm))


# ---------------------------------------------------------------- pairs against the truth


def pairs() -> None:
    """What Park's pairs find and miss, at 40 random poses of the nominal arm, as he takes them."""
    print("\nPark's pairwise redundancy against the truth, 40 random poses, positions in the base frame")
    print(
        f"{'':8} {'parameters':>10} {'pairs keep':>10} {'no influence':>12} {'rank':>5}   kept, yet redundant"
    )
    reports = []
    for robot in (park_arm("rb5"), park_arm("panda"), ur10(), scara()):
        rng = np.random.default_rng(5)
        by = kinematics.target_jacobian(robot, random_q(robot, 40, rng))
        found = analyse(by.reshape(-1, by.shape[-1]), robot.parameter_names, robot.parameter_units)
        idle = sum(name in found.no_influence for name in found.kept)
        print(
            f"{robot.name:8} {len(found.parameters):10} {len(found.kept):10} {idle:12} {found.rank:5}   "
            f"{len(found.kept) - idle - found.rank}: {len(found.mixed_groups)} groups of mm with rad, "
            f"{len(found.combinations)} combinations of three or more"
        )
        reports.append(f"{robot.name}: {found.summary()}")
    print("\n" + "\n\n".join(reports))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts", nargs="*", default=[], help="exact, missing, sigmas, pairs; all where none is named"
    )
    parser.add_argument("--robots", type=int, default=200)
    arguments = parser.parse_args()
    for name in arguments.parts or ["exact", "missing", "sigmas", "pairs"]:
        {"exact": exact, "missing": missing, "sigmas": sigmas, "pairs": lambda _: pairs()}[name](
            arguments.robots
        )


if __name__ == "__main__":
    main()
