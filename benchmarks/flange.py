"""A scanner on the flange, a jig in the room: random arms and mounts, beside the Cramer-Rao bound.

    python benchmarks/flange.py [--arms 1000] [--poses 64] [--noise-mm 0.05] [--share 1] [--seed 1]

Each arm has 5 to 7 joints with axes at right angles, parallel or anyhow, links of up to half a metre, and link errors
from the tolerances that the fit takes for its prior (1 mm, 0.5 deg), or a share of them: 0 is an arm whose table is
true, of which no fit should be worse than that of the mount alone, the column "nominal". The scanner sits on the
flange anyhow, the jig stands anywhere within 1.5 m; 51 poses are for the fit and 13 for testing. No first guess is
given. The simulator is `calib.simulation.truth`, which shares no code with the fit; nor does the bound, by differences
of it: the covariance of the predicted points at the test poses for the best unbiased estimate (with the tolerances as
prior: van Trees 1968), of link errors, the scanner's six and the jig's three unknowns together.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib import calibrate
from calib.dataset.dataset import Poses
from calib.effects.link_errors import TOLERANCE_MM, TOLERANCE_RAD
from calib.errors import CalibError
from calib.kinematics.robot import Joint, Robot, Tool
from calib.options import FitOptions
from calib.simulation.simulate import measure
from calib.simulation.truth.equilibrium import Truth, scanner_T_target
from calib.statistics import rms_length

Array = NDArray[np.float64]
STEP_MM, STEP_RAD = 0.1, 1e-4  # of differences


@dataclass(frozen=True)
class Outcome:
    """Held-out errors of one arm against the true points, rms of the 3D error, mm."""

    joints: int
    converged: bool
    steps: int
    before_mm: float  # of the nominal arm, scanner and jig placed in closed form
    after_mm: float
    bound_mm: float  # with the tolerances as prior
    bound_alone_mm: float  # by the points alone
    seconds: float


def random_arm(rng: np.random.Generator, joints: int) -> Robot:
    """Any serial arm: of four twists one is none, two are right angles, one is anything."""

    def twist() -> float:
        return float(rng.choice([0.0, np.pi / 2, -np.pi / 2, rng.uniform(-np.pi, np.pi)]))

    rows = [
        Joint(
            a_mm=float(rng.choice([0.0, rng.uniform(50.0, 500.0)])),
            alpha_rad=twist(),
            d_mm=float(rng.choice([0.0, rng.uniform(-300.0, 500.0)])),
            theta_rad=float(rng.uniform(-np.pi, np.pi)),
            name=f"J{k + 1}",
        )
        for k in range(joints)
    ]
    return Robot("random", tuple(rows), Tool(), carries_scanner=True)


def transform(rotation: Array, place_mm: Array) -> Array:
    """Rigid transform (4, 4) of a rotation and a shift."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, place_mm
    return out


def drawn(rng: np.random.Generator, joints: int, share: float) -> tuple[Robot, Truth]:
    """A nominal arm, and the cell of the real one."""
    nominal = random_arm(rng, joints)
    sizes = share * np.array([TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_RAD])
    real = nominal.with_table(nominal.table + sizes * rng.standard_normal(nominal.table.shape))
    mount = transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-200.0, 200.0, 3))
    jig = transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(-1500.0, 1500.0, 3))
    return nominal, Truth(real, {"": mount}, base_T_jig=jig)


def jacobian(truth: Truth, q: Array) -> Array:
    """(N, 3, P) of the true points by the table, the scanner's motion and the jig's place, by differences."""
    table = truth.robot.table
    (mount,) = truth.scanners.values()
    assert truth.base_T_jig is not None
    ways: list[tuple[float, tuple[Truth, Truth]]] = []
    for index in np.ndindex(table.shape):
        size = STEP_MM if index[1] in (0, 2) else STEP_RAD
        step = np.zeros_like(table)
        step[index] = size
        high, low = (replace(truth, robot=truth.robot.with_table(table + s * step)) for s in (1.0, -1.0))
        ways.append((size, (high, low)))
    for axis in np.eye(3):
        turns = [transform(Rotation.from_rotvec(s * STEP_RAD * axis).as_matrix(), np.zeros(3)) for s in (1, -1)]
        shifts = [transform(np.eye(3), s * STEP_MM * axis) for s in (1, -1)]
        for size, (more, less) in ((STEP_RAD, turns), (STEP_MM, shifts)):
            ways.append((size, tuple(replace(truth, scanners={"": mount @ way}) for way in (more, less))))  # type: ignore[arg-type]
        high, low = (replace(truth, base_T_jig=way @ truth.base_T_jig) for way in shifts)
        ways.append((STEP_MM, (high, low)))
    columns = []
    for size, (high, low) in ways:
        columns.append((scanner_T_target(high, q) - scanner_T_target(low, q))[:, :3, 3] / (2.0 * size))
    return np.stack(columns, axis=-1)


def bound_mm(truth: Truth, train: Array, test: Array, noise_mm: float, *, prior: bool) -> float:
    """Rms 3D error of the predicted points at the test poses, of the best estimate."""
    tolerance = np.array([TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_MM, TOLERANCE_RAD, TOLERANCE_RAD])
    scale = np.concatenate([np.tile(tolerance, len(truth.robot.table)), np.tile([TOLERANCE_RAD, 1.0, 1.0], 3)])
    links = truth.robot.table.size
    seen = jacobian(truth, train).reshape(-1, len(scale)) * scale / noise_mm
    asked = jacobian(truth, test).reshape(-1, len(scale)) * scale
    if prior:
        seen = np.concatenate([seen, np.eye(len(scale))[:links]])
    _, s, vt = np.linalg.svd(seen, full_matrices=False)
    known = s > 1e-6 * s[0]  # differences are no better
    spread = (asked @ vt[known].T) / s[known]
    return float(np.sqrt(np.sum(spread**2) / len(test)))


def one(rng: np.random.Generator, joints: int, poses: int, noise_mm: float, share: float) -> Outcome:
    """Simulate an arm, fit it, and hold it against the bound."""
    nominal, truth = drawn(rng, joints, share)
    q = rng.uniform(-np.pi, np.pi, (poses, joints))
    role = np.full(poses, "train", dtype="<U9")
    role[0], role[-13:] = "reference", "test"
    ids = tuple(f"p{k + 1}" for k in range(poses))
    table = Poses(ids, role, q, np.full(poses, ""), ("",) * poses)
    made = measure(nominal, truth, table, rng=rng, name="random", noise_mm=noise_mm)
    began = time.process_time()
    result = calibrate(made.dataset, FitOptions())
    seconds = time.process_time() - began
    test = table.is_test
    measured = made.dataset.points
    assert measured is not None

    def off(error_mm: Array) -> float:
        missed = (measured.xyz_mm + error_mm - made.apex_mm)[test]
        return rms_length(missed)

    return Outcome(
        joints,
        result.fit.converged,
        len(result.fit.iterations) - 1,
        off(result.before.error_mm),
        off(result.after.error_mm),
        bound_mm(truth, q[~test], q[test], noise_mm, prior=True),
        bound_mm(truth, q[~test], q[test], noise_mm, prior=False),
        seconds,
    )


def report(name: str, outcomes: list[Outcome]) -> None:
    """A line of the table: `sums` is the rms error of all arms over the rms bound, `each` the rms of the ratios."""

    def rms(values: list[float]) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    after, bound = [o.after_mm for o in outcomes], [o.bound_mm for o in outcomes]
    alone = [o.bound_alone_mm for o in outcomes]
    ratio = np.array(after) / np.array(bound)
    print(
        f"{name:9} {len(outcomes):5d} {sum(o.converged for o in outcomes):9d} "
        f"{int(np.median([o.steps for o in outcomes])):5d} {max(o.steps for o in outcomes):4d} "
        f"{np.median([o.before_mm for o in outcomes]):10.4g} {np.median(after):9.4f} {np.median(bound):9.4f} "
        f"{rms(after) / rms(bound):8.3f} {rms(ratio.tolist()):8.3f} {rms((np.array(after) / alone).tolist()):8.3f} "
        f"{ratio.max():7.2f} {np.median([o.seconds for o in outcomes]):7.2f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=1000)
    parser.add_argument("--poses", type=int, default=64)
    parser.add_argument("--noise-mm", type=float, default=0.05)
    parser.add_argument("--share", type=float, default=1.0, help="of the tolerances, that links are off by")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    failed: list[str] = []
    for k in range(options.arms):
        rng = np.random.default_rng([options.seed, k])
        try:
            outcomes.append(one(rng, 5 + k % 3, options.poses, options.noise_mm, options.share))
        except CalibError as error:
            failed.append(f"arm {k}: {error}")
    print(f"{options.arms} arms, {options.poses - 13} poses to fit and 13 to test, {options.noise_mm:g} mm noise")
    print(
        "              converged steps most  nominal mm held-out     bound  of sums  of each   no prior  worst  s\n"
        "                        medians       (median)  (median)  (median)  error over bound"
    )
    for joints in (5, 6, 7):
        report(f"{joints} joints", [o for o in outcomes if o.joints == joints])
    report("all", outcomes)
    print(f"refused: {len(failed)}", *failed[:10], sep="\n  ")


if __name__ == "__main__":
    main()
