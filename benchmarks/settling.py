"""Confounded effects told apart by planned poses: `python benchmarks/settling.py [--arms N] [--seed S] [--bare]`.

Arms with one hidden effect of load (`calib/simulation/truth`, which shares no code with what fits) are measured and
diagnosed. Where the diagnosis ends open, five poses are planned, measured on the same arm, and everything is diagnosed
again. Beside it a yardstick that plans nothing: forty random poses that can be measured, under the same conditions. A
set that these do not settle either counts as one that poses cannot settle.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import diagnose
from calib.dataset.dataset import Dataset, Points, Poses
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.planning.discrimination import for_confounded
from calib.planning.plan import plan_poses
from calib.simulation.simulate import Simulation, measure, simulate_dataset
from calib.workcell.candidates import candidate_poses

EFFECTS = ("joint_compliance", "link_bending", "base_compliance")
ROBOTS = {"rb5": 5.0, "panda": 3.0}  # and what each may carry, kg
NOISE_MM = 0.05
SURELY = 40  # random poses of the yardstick


@dataclass(frozen=True)
class Arm:
    """A simulated arm, all drawn from its seed."""

    seed: int

    def simulate(self) -> tuple[Simulation, str, float]:
        """Measured dataset, its effect, and what the arm may carry."""
        rng = np.random.default_rng(self.seed)
        name = list(ROBOTS)[self.seed % 2]
        effect = EFFECTS[(self.seed // 2) % 3]
        poses = int(rng.choice([20, 24, 30, 40, 64]))
        sigmas = float(np.exp(rng.uniform(np.log(0.6), np.log(5.0))))
        payloads = (0.0, ROBOTS[name]) if rng.random() < 0.3 else ()
        simulation = simulate_dataset(
            builtin_robot(name),
            rng=rng,
            effects=[(effect, sigmas)],
            poses=poses,
            noise_mm=NOISE_MM,
            payloads_kg=payloads,
        )
        return simulation, effect, ROBOTS[name]


def with_more(simulation: Simulation, further: Poses, rng: np.random.Generator) -> Dataset:
    """The dataset with further poses measured on the same arm."""
    before = simulation.dataset
    poses = _joined(before.poses, further)
    again = measure(before.robot, simulation.truth, poses, rng=rng, name=before.name, noise_mm=NOISE_MM).dataset.points
    old = before.points
    assert again is not None
    assert old is not None
    new = again.select(again.pose >= len(before.poses))
    order = np.argsort(np.concatenate([old.pose, new.pose]), kind="stable")
    points = Points(
        np.concatenate([old.pose, new.pose])[order],
        np.concatenate([old.xyz_mm, new.xyz_mm])[order],
        np.concatenate([old.target, new.target])[order],
    )
    return replace(before, poses=poses, points=points)


def _joined(one: Poses, other: Poses) -> Poses:
    payload_kg = None
    if one.payload_kg is not None or other.payload_kg is not None:
        parts = (np.zeros(len(p)) if p.payload_kg is None else p.payload_kg for p in (one, other))
        payload_kg = np.concatenate(list(parts))
    return Poses(
        ids=(*one.ids, *(f"more{k + 1}" for k in range(len(other)))),
        role=np.concatenate([one.role, np.full(len(other), "train", dtype="<U9")]),
        q=np.concatenate([one.q, other.q]),
        setup=np.concatenate([one.setup, other.setup]),
        scan_names=(*one.scan_names, *other.ids),
        payload_kg=payload_kg,
    )


def outcome(dataset: Dataset, effect: str) -> str:
    """right: the effect is claimed and nothing else is. wrong: another one is claimed. open: neither."""
    found = diagnose(dataset)
    claimed = set(found.missing)
    if claimed == {effect}:
        return "right"
    return "wrong" if claimed - {effect} else "open"


def run(arm: Arm, count: int, bare: bool) -> dict[str, object] | None:
    """Row of the table for an arm whose diagnosis ends open; None for others."""
    simulation, effect, payload_kg = arm.simulate()
    found = diagnose(simulation.dataset)
    if found.verdict != "ambiguous":
        return None
    try:
        criterion = for_confounded(found, None if bare else payload_kg)
    except CalibError:
        return None
    start = time.perf_counter()
    plan = plan_poses(criterion.start, count, criterion=criterion, seed=arm.seed)
    seconds = time.perf_counter() - start
    rng = np.random.default_rng([arm.seed, 1])
    after = outcome(with_more(simulation, plan.poses, rng), effect)
    anywhere = criterion.start.poses_at(candidate_poses(criterion.start.cell, SURELY, rng=rng))
    surely = outcome(with_more(simulation, criterion.prepared(criterion.start, anywhere), rng), effect)
    return {
        "seed": arm.seed,
        "robot": simulation.dataset.robot.name,
        "effect": effect,
        "rivals": " ".join(hypothesis.name for hypothesis in criterion.hypothesis_set.hypotheses),
        "holds truth": effect in criterion.hypothesis_set.names,
        "predicted": plan.power,
        "after": after,
        "by forty": surely,
        "seconds": seconds,
    }


def tell(rows: pd.DataFrame, arms: int, count: int) -> None:
    """The shares, over all open sets and over those that forty random poses settle, and predicted against realised."""
    print(f"{len(rows)} open sets of {arms} arms; {count} planned poses more:")
    can = rows["by forty"] == "right"
    for words, some in (("all", rows), ("that forty random poses settle", rows[can])):
        shares = {key: int((some["after"] == key).sum()) for key in ("right", "wrong", "open")}
        print(
            f"  {words}: {len(some)}; settled rightly {shares['right']} "
            f"({100 * shares['right'] / max(len(some), 1):.0f} %), wrongly {shares['wrong']}, "
            f"still open {shares['open']}"
        )
    print(f"  forty random poses settle {int(can.sum())} rightly, {int((rows['by forty'] == 'wrong').sum())} wrongly")
    print("  predicted probability -> share settled rightly:")
    edges = [0.0, 0.25, 0.5, 0.75, 0.9, 1.001]
    for low, high in pairwise(edges):
        some = rows[(rows["predicted"] >= low) & (rows["predicted"] < high)]
        if len(some):
            right = (some["after"] == "right").mean()
            mean = some["predicted"].mean()
            print(f"    {low:.2f} to {min(high, 1.0):.2f}: {len(some):3d} sets, mean {mean:.2f} -> {right:.2f}")
    print(f"    all: mean {rows['predicted'].mean():.2f} -> {(rows['after'] == 'right').mean():.2f}")
    print(
        f"  sets that hold the truth: {int(rows['holds truth'].sum())}; a plan took {rows['seconds'].median():.2f} s "
        f"(median), {rows['seconds'].max():.2f} s at most"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=120)
    parser.add_argument("--seed", type=int, default=0, help="of the first arm")
    parser.add_argument("--poses", type=int, default=5, help="that are planned")
    parser.add_argument("--bare", action="store_true", help="no payload where the data have none")
    options = parser.parse_args(arguments)
    found = []
    for seed in range(options.seed, options.seed + options.arms):
        row = run(Arm(seed), options.poses, options.bare)
        if row is not None:
            found.append(row)
            print(
                "{seed:4d} {robot} {effect} ({rivals}): predicted {predicted:.2f} -> {after}; "
                "forty: {by forty}; {seconds:.1f} s".format(**row),
                flush=True,
            )
    tell(pd.DataFrame(found), options.arms, options.poses)


if __name__ == "__main__":
    main()
