"""Confounded effects proven by a planned change: `python benchmarks/proving.py [--arms N] [--seed S] [--engine NAME]`.

Arms of which one effect of load is hidden are measured and diagnosed. Where the diagnosis ends open, the change that
`plan --for prove` names is made on the same arm, and the pairs are judged. Printed is the reliability of the promise:
of sets promised at p, the share that is settled, which should be p. Two engines make the measurements: `own`
(`calib/simulation`, whole families of soft joints or links), and `other` (`tests.support.engine`, one soft part, other
laws and other code).
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from settling import EFFECTS, NOISE_MM, ROBOTS, Arm, with_more

from calib import diagnose
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.extras.proof_plan.proof_plan import NextChange, next_change
from calib.simulation.simulate import Simulation, simulate_dataset
from tests.support.engine.cases import robot_of
from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell, draw_cell
from tests.support.paired_cell import ARMS, LARGEST, base, members_of, proofs_of

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.001)  # of the promised probabilities in the table
PAYLOAD_KG = 5.0
VISIBLE_MM = (0.03, 0.4)  # what geometry leaves of a hidden cause, a coordinate
SIGMAS = (1.0, 15.0)  # of the own engine's effects, over their usual size


@dataclass(frozen=True)
class Case:
    """A set left open, what was promised for it, and what came of it."""

    seed: int
    truth: str
    promised: float
    poses: int
    verdict: str  # right, open or wrong


def verdict(found: set[tuple[str, int | None]], truth: set[tuple[str, int | None]]) -> str:
    """What is proven: parts of the truth alone are right, anything else is wrong, nothing is open."""
    return "open" if not found else "right" if found <= truth else "wrong"


def own_case(seed: int) -> Case | None:
    """An arm of calib's own simulator; None where its diagnosis leaves nothing open."""
    simulation, effect = _own_arm(seed)
    change = next_change(diagnose(simulation.dataset), payload_kg=ROBOTS[list(ROBOTS)[seed % 2]])
    if change is None:
        return None
    before = simulation.dataset
    if change.assumed:
        before = replace(before, poses=replace(before.poses, payload_kg=np.zeros(len(before.poses))))
    again = with_more(replace(simulation, dataset=before), change.poses, np.random.default_rng([seed, 1]))
    found = {proof.effect for proof in proofs_of(again)}
    return Case(
        seed, effect, change.probability, len(change.poses), verdict({(f, None) for f in found}, {(effect, None)})
    )


def _own_arm(seed: int) -> tuple[Simulation, str]:
    drawn, rng = Arm(seed), np.random.default_rng([seed, 7])
    effect, name = EFFECTS[(drawn.seed // 2) % 3], list(ROBOTS)[seed % 2]
    sigmas = float(np.exp(rng.uniform(*np.log(SIGMAS))))
    poses = int(rng.choice([20, 30, 40, 64]))
    robot = builtin_robot(name)
    return simulate_dataset(robot, rng=rng, effects=[(effect, sigmas)], poses=poses, noise_mm=NOISE_MM), effect


def other_case(seed: int) -> Case | None:
    """An arm of the other engine with one soft part; None where its diagnosis leaves nothing open."""
    rng = np.random.default_rng([seed, 8])
    arm = ARMS[list(ARMS)[seed % 3]]
    cell = draw_cell(arm, rng, poses=int(rng.choice([20, 30, 40, 64])), payload=False, paced=True)
    parts = [*members_of(arm), base(rng.uniform(0.5, 1.5, 2))]
    kinds = sorted(LARGEST)
    parts = [part for part in parts if part.effect == kinds[(seed // 3) % 3]]
    part = parts[int(rng.integers(len(parts)))]
    size = cell.size_for(part.cause, float(np.exp(rng.uniform(*np.log(VISIBLE_MM)))))
    if not np.isfinite(size) or size * 1e-6 > LARGEST[part.effect]:
        return None
    change = next_change(diagnose(_dataset(cell, part.cause, size, rng)), payload_kg=PAYLOAD_KG)
    if change is None or change.change.condition != "payload_kg":
        return None
    after = _dataset(_again(cell, change), part.cause, size, rng)
    found = {(proof.effect, proof.joint) for proof in proofs_of(after)}
    return Case(seed, part.effect, change.probability, len(change.poses), verdict(found, {(part.effect, part.joint)}))


def _again(cell: Cell, change: NextChange) -> Cell:
    """The cell with the planned poses after those that were measured."""
    more, n = len(change.poses), cell.poses
    assert change.poses.payload_kg is not None
    return replace(
        cell,
        q=np.concatenate([cell.q, change.poses.q]),
        payload_kg=np.concatenate([cell.payload_kg, change.poses.payload_kg]),
        temperature_c=np.full(n + more, 22.0),
        time_s=30.0 * np.arange(n + more),
        approach=np.ones((n + more, cell.q.shape[1])),
        setup=np.zeros(n + more, dtype=np.int64),
    )


def _dataset(cell: Cell, cause: Cause, size: float, rng: np.random.Generator) -> Dataset:
    n = cell.poses
    role = np.full(n, "train", dtype="<U9")
    role[0] = "reference"
    ids = tuple(f"p{k + 1:03d}" for k in range(n))
    payload_kg = cell.payload_kg if np.ptp(cell.payload_kg) > 0.0 else None
    poses = Poses(ids, role, cell.q, np.full(n, ""), tuple(f"{name}.ply" for name in ids), payload_kg=payload_kg)
    xyz_mm = cell.reported([(cause, size)])["jig"] + NOISE_MM * rng.standard_normal((n, 3))
    points = Points(np.arange(n), xyz_mm, np.full(n, "jig"))
    return Dataset("one soft part", robot_of(cell), poses, points, scanner=Scanner(point_sigma_mm=NOISE_MM))


ENGINES = {"own": own_case, "other": other_case}


def told(cases: Sequence[Case]) -> Iterator[str]:
    """Lines of the reliability table."""
    for low, high in pairwise(EDGES):
        some = [case for case in cases if low <= case.promised < high]
        if some:
            right, wrong = (sum(case.verdict == word for case in some) for word in ("right", "wrong"))
            mean = np.mean([case.promised for case in some])
            yield (
                f"  promised {low:.1f} to {min(high, 1.0):.1f}: {len(some):3d} sets, {mean:.2f} on average; "
                f"settled {right / len(some):.2f} ({right}), wrong {wrong}"
            )
    right = np.mean([case.verdict == "right" for case in cases]) if cases else float("nan")
    yield f"  all: {len(cases)} sets, promised {np.mean([c.promised for c in cases]):.2f}, settled {right:.2f}"


def main() -> None:
    """Run what is asked for and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    parser.add_argument("--engine", choices=sorted(ENGINES), action="append")
    asked = parser.parse_args()
    for engine in asked.engine or ENGINES:
        cases = []
        for seed in range(asked.seed, asked.seed + asked.arms):
            case = ENGINES[engine](seed)
            if case is not None:
                cases.append(case)
                print(
                    f"{engine} {case.seed:4d} {case.truth}: promised {case.promised:.2f} by {case.poses} poses, "
                    f"{case.verdict}",
                    flush=True,
                )
        print(f"{engine}:", *told(cases), sep="\n", flush=True)


if __name__ == "__main__":
    main()
