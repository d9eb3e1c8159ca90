"""The solver on many random robots, beside the bounds and beside the plain iteration of the papers.

    python benchmarks/solver.py [exact] [missing] [sigmas] [pairs] [--robots 100]

exact    noise-free, Park 2022's set-up: how far, how fast, how surely missing  0.05 mm noise and joints that yield by
1e-4 rad/Nm, which the model does not know: does anything diverge sigmas   are the sigmas true, and is the error at the
Cramer-Rao bound pairs    Park's pairwise redundancy against the rank: RB5, Panda, UR10, a SCARA

Robot k of a part is the same at any count. `--robots 200` is what the README quotes.
"""

from __future__ import annotations

import argparse
import os

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
    rms_3d,
    scara,
    ur10,
)
from plain import Outcome, held_out_mm, plain, plain_distances, plain_positions

from calib.dataset.dataset import Dataset
from calib.fitting.fit import Fit
from calib.fitting.model import Model, geometric_model
from calib.fitting.observations import Observations
from calib.fitting.position_residuals import PositionResiduals
from calib.fitting.residual_kinds import make_residuals
from calib.fitting.trust_region import solve
from calib.identifiability.redundancy import analyse
from calib.kinematics import chain as kinematics
from calib.kinematics.robot import Robot, Tool
from calib.simulation.truth.equilibrium import Truth
from calib.simulation.truth.load_effects import JointCompliance
from calib.statistics import rms
from tests.support.arms import park_arm

# ---------------------------------------------------------------- exact data


def spread(values: Array) -> str:
    """Median, 99th percentile and worst."""
    return f"{np.median(values):9.1e} {np.quantile(values, 0.99):9.1e} {np.max(values):9.1e}"


def distance_rms_mm(model: Model, x: Array, dataset: Dataset) -> float:
    """RMS error of the distances to the first pose."""
    assert dataset.points is not None
    base_mm, seen_mm = model.predict(x, dataset.poses), dataset.points.xyz_mm
    error = np.linalg.norm(base_mm[1:] - base_mm[0], axis=1) - np.linalg.norm(seen_mm[1:] - seen_mm[0], axis=1)
    return rms(error)


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
    print(f"\nExact data, {count} random robots: RB5, Panda, random arms of 5, 6, 7 joints, {count // 5} each")
    head = "RMSE mm: median      99 %     worst   iterations: median  99 %  most  within 8"
    print(f"{'':26} {'converged':>11} {'diverged':>9}   {head}")
    for name, _ in cases:
        steps = np.array([len(fit.iterations) - 1 for fit in fits[name]])
        worse = sum(not fit.iterations[-1].cost < fit.iterations[0].cost for fit in fits[name])
        print(
            f"{name:26} {sum(f.converged for f in fits[name]):5} /{count:5} {worse:9}           "
            f"{spread(np.array(rmse[name]))} {np.median(steps):18.0f} {np.quantile(steps, 0.99):5.0f} {steps.max():5} "
            f"{np.sum(steps <= 8):9}"
        )
    print(f"{'rounding: two codes, truth':48}           {spread(np.array(floor))}")
    print(f"{'paper, best of five cases':48}             1.9e-13 .. 2.5e-13                  300 to 1000")


# ---------------------------------------------------------------- a strong effect missing


def missing(count: int) -> None:
    """64 poses, 13 held out, 0.05 mm noise, joints of 1e-4 rad/Nm: ours by both residuals, the plain step beside."""
    for label, mm, rad in (("1 mm, 3 mrad (Park)", 1.0, 0.003), ("0.3 mm, 0.1 deg", 0.3, np.radians(0.1))):
        missing_with(count, label, mm, rad)
    print("plain: x <- x - J^+ r, 20 times, mm and rad as they are, no damping, no prior; singular values below")
    print("max(J.shape) eps s1 are taken for zero. Blew up: the cost rose above 100 times its start on the way.")


def missing_with(count: int, label: str, mm: float, rad: float) -> None:
    """`missing` for link errors of one size."""
    names = ("ours, positions", "ours, distances", "plain, positions", "plain, distances (Jang eq 16)")
    outcomes: dict[str, list[Outcome]] = {name: [] for name in names}
    nominal_mm = []
    for k in range(count):
        rng = np.random.default_rng([2, k])
        _, robot = heavy_arm(k, rng)
        truth = Truth.without_effects(off_by(robot, rng, mm=mm, rad=rad), anywhere(rng))
        truth = truth.with_effects(JointCompliance(np.full(robot.n_joints, 1e-4)))
        dataset = measured(robot, truth, random_q(robot, 64, rng), rng, noise_mm=NOISE_MM, test=13)
        model, observed = geometric_model(robot), Observations.of(dataset)
        nominal = held_out_mm(model, np.zeros(len(model.parameters)), dataset)
        nominal_mm.append(nominal)
        for kind in ("position", "distance"):
            fit = solve(make_residuals(kind, model, observed))
            costs = [i.cost / fit.iterations[0].cost for i in fit.iterations]
            after = held_out_mm(model, fit.x, dataset)
            outcome = Outcome(costs[-1], after / nominal, max(costs), len(costs) - 1, fit.converged)
            outcomes[f"ours, {kind}s"].append(outcome)
        outcomes[names[2]].append(plain(*plain_positions(model, observed), model, dataset, nominal))
        outcomes[names[3]].append(plain(*plain_distances(model, observed), model, dataset, nominal))
    print(
        f"\nJoints yield by 1e-4 rad/Nm, unknown to the model; link errors {label}; {NOISE_MM} mm noise; {count} robots"
    )
    print(f"nominal arm, held-out RMSE: median {np.median(nominal_mm):.2f} mm, largest {max(nominal_mm):.1f} mm")
    head = ("converged", "iterations", "blew up", "worse than nominal", "held-out RMSE over nominal")
    print(f"{'':30} {head[0]:>9} {head[1]:>11} {head[2]:>8} {head[3]:>19}   {head[4]}")
    print(f"{'':41}{'med / max':>10} {'':>8} {'training':>9} {'held-out':>9}      median      99 %     worst")
    for name, all_of in outcomes.items():
        steps = [o.steps for o in all_of]
        print(
            f"{name:30} {sum(o.converged for o in all_of) if name.startswith('ours') else '-':>9} "
            f"{np.median(steps):5.0f} / {max(steps):3} {sum(not o.largest < 100.0 for o in all_of):>8} "
            f"{sum(not o.cost < 1.0 for o in all_of):>9} {sum(not o.held_out < 1.0 for o in all_of):>9}   "
            f"{spread(np.array([o.held_out for o in all_of]))}"
        )


# ---------------------------------------------------------------- sigmas and the bound


def sigmas(count: int) -> None:
    """Normalised errors of what the data know, the errors against the bound, and the predictions' against theirs."""
    print(f"\nHonest sigmas and the Cramer-Rao bound: {count} robots, 64 poses, free scanner, {NOISE_MM} mm noise")
    print(f"{'':34} {'not':>9} {'combinations':>13} {'variance of':>17} {'RMS error':>14} {'point error':>14}")
    print(f"{'':34} {'converged':>9} {'a robot':>13} {'normalised errors':>17} {'over bound':>14} {'over bound':>14}")
    for label, prior, independent, straight in (
        ("prior off, independent parameters", False, True, True),
        ("the same, by their effect", False, True, False),
        ("prior off, all parameters", False, False, False),
        ("prior on, truths from the prior", True, False, False),
    ):
        results = [one_sigma(k, prior=prior, independent=independent, straight=straight) for k in range(count)]
        good = [r for r in results if r is not None]
        own = np.concatenate([r[0] for r in good])
        bound = np.concatenate([r[1] for r in good])
        point = np.array([r[2] for r in good])
        print(
            f"{label:34} {count - len(good):9} {len(bound) / len(good):13.1f} "
            f"{np.mean(own**2):9.3f} +- {np.sqrt(2 / len(own)):.3f} "
            f"{rms(bound):14.4f} {np.sqrt(np.mean(point)):14.4f}"
        )
    print(
        "combinations: v . x along the directions v of the whitened, scaled Jacobian J = u s v^T at the truth with\n"
        "s > 1, which the data know better than their tolerance does. By their effect: u . (f(x) - f(truth)) / s, the\n"
        "same to first order, unmoved by the curved drift of what nobody knows. Point error: 100 fresh poses."
    )


def one_sigma(k: int, *, prior: bool, independent: bool, straight: bool) -> tuple[Array, Array, float] | None:
    """Errors over the fit's sigmas, over the bound's, and mean squared error of predictions over the bound's."""
    rng = np.random.default_rng([3, k])
    _, robot = mixed_arm(k, rng)
    model = geometric_model(robot)
    q = random_q(robot, 64, rng)
    if independent:
        names, units = robot.parameter_names, robot.parameter_units
        here = observed_of(robot, robot, q, np.eye(4), rng, 0.0)
        columns = PositionResiduals(model, here).linearise(np.zeros(len(names))).jacobian
        model = model.with_fixed([n for n in names if n not in analyse(columns, names, units).independent])
    # A prior is believed only where truths follow it; without one, errors are those of a good factory.
    scale = model.scales if prior else model.scales * 0.2
    x_true = scale * rng.standard_normal(len(scale))
    observed = observed_of(robot, model.calibrated_robot(x_true), q, anywhere(rng), rng, NOISE_MM)
    residuals = PositionResiduals(model, observed)
    fit = solve(residuals, prior=prior)
    if not fit.converged:
        return None

    scales = model.scales
    jacobian = residuals.linearise(x_true).jacobian * scales
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    knows = s > 1.0
    u, s, vt = u[:, knows], s[knows], vt[knows]
    information = s**2 + (1.0 if prior else 0.0)
    covariance = fit.covariance / np.outer(scales, scales)
    if straight:
        error, carried = vt @ ((fit.x - x_true) / scales), vt
    else:
        error = (residuals.residual(fit.x) - residuals.residual(x_true)) @ u / s
        carried = (u.T / s[:, None]) @ (residuals.linearise(fit.x).jacobian * scales)
    own = np.sqrt(np.einsum("kp,pq,kq->k", carried, covariance, carried))

    fresh = random_q(robot, 100, rng)
    new = observed_of(robot, model.calibrated_robot(x_true), fresh, np.eye(4), rng, 0.0)
    by = PositionResiduals(model, new).linearise(x_true).jacobian * scales @ vt.T
    off = PositionResiduals(model, new).residual(fit.x)
    return error / own, error * np.sqrt(information), float(off @ off) / float(np.sum(by**2 / information))


def observed_of(
    robot: Robot, true: Robot, q: Array, place: Array, rng: np.random.Generator, noise_mm: float
) -> Observations:
    """Points of a rigid arm seen from a place."""
    return Observations.of(measured(robot, Truth.without_effects(true, place), q, rng, noise_mm=noise_mm))


# ---------------------------------------------------------------- pairs against the truth


def pairs() -> None:
    """Print what Park's pairs find and miss, at 40 random poses of the nominal arm, as he takes them."""
    print("\nPark's pairwise redundancy against the truth, 40 random poses, positions in the base frame")
    print(f"{'':8} {'parameters':>10} {'pairs keep':>10} {'no influence':>12} {'rank':>5}   kept, yet redundant")
    reports = []
    for robot in (park_arm("rb5"), park_arm("panda"), ur10(Tool(d_mm=100.0)), scara()):
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
    """Run the parts that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=[], help="exact, missing, sigmas, pairs; all where none is named")
    parser.add_argument("--robots", type=int, default=100)
    arguments = parser.parse_args()
    for name in arguments.parts or ["exact", "missing", "sigmas", "pairs"]:
        {"exact": exact, "missing": missing, "sigmas": sigmas, "pairs": lambda _: pairs()}[name](arguments.robots)


if __name__ == "__main__":
    main()
