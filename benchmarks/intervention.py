"""Causes proven by measuring the same poses without and with a weight, beside brute force over what may give way.

Truth and bound are of `tests.support.engine`, which shares no code with calib: one joint, one link or the pedestal
gives way; 20 random poses are measured with 0 and 2 kg, white noise of 0.05 mm a coordinate. A size is the root mean
square a coordinate of the differences that the cause makes, over that noise; a part takes it only where it then yields
no more than parts of real arms do. The bound knows the noise and that exactly one of these parts gives way; it allows
for a motion of the instrument and a shift of the tool, and calls the best part proven where that leads the next by 3 in
log evidence. *right*: the part that gave way and nothing else; *right set*: with parts that yield alike; *open*:
nothing proven; *wrong*: anything else.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from simulated import NOISE_MM

from calib.array_types import Array
from calib.statistics import rms
from tests.support.engine.cell import Cell
from tests.support.paired_cell import (
    ARMS,
    LARGEST,
    Member,
    base,
    difference_mm,
    draw_pairs,
    measured,
    members_of,
    places_of,
    proofs_of,
)

SIZED_KG = 2.0  # load under which a size is what it says
SIZES = (1.0, 2.0, 3.0)
LEAD = 3.0
SCALES_MM = NOISE_MM * np.geomspace(0.03, 30.0, 41)  # of a part's root mean square, that the bound tries


@dataclass(frozen=True)
class Task:
    """One case: an arm, a size (0: nothing gives way), the number of poses and of the case."""

    arm: str
    size: float
    places: int
    number: int
    seed: int
    load_kg: float = SIZED_KG


def judged(task: Task) -> tuple[str, str]:
    """What the bound and what calib say of a case: right, open or wrong."""
    key = [task.seed, list(ARMS).index(task.arm), round(10 * task.size), task.places, task.number]
    rng = np.random.default_rng(key)
    arm = ARMS[task.arm]
    at_random = draw_pairs(arm, rng, task.places, (0.0, SIZED_KG))
    cell = loaded(at_random, task.load_kg)
    soft = rng.uniform(0.5, 1.5, 2)
    nuisance = nuisance_of(cell)
    parts = [(part, columns_of(cell, part)) for part in [*members_of(arm), base(soft)]]
    parts = [(part, columns) for part, columns in parts if shows(columns, nuisance)]
    truth, causes = set(), []
    if task.size:
        sized = [(part, columns_of(at_random, part)) for part, _ in parts]
        part, size = part_that_yields(sized, soft, task, rng)
        truth, causes = {(part.effect, part.joint)}, [(part.cause, size)]
    dataset = measured(cell, causes, rng, noise_mm=NOISE_MM)
    found = [{(one.effect, one.joint) for one in proof.alike or (proof,)} for proof in proofs_of(dataset)]
    assert dataset.points is not None
    bound = best_part(parts, nuisance, dataset.points.xyz_mm)
    return verdict([] if bound is None else [{bound}], truth), verdict(found, truth)


def loaded(cell: Cell, load_kg: float) -> Cell:
    """The cell with another load on the flange in its second run."""
    return replace(cell, payload_kg=np.where(cell.payload_kg > 0.0, load_kg, 0.0))


def part_that_yields(
    parts: Sequence[tuple[Member, Array]], soft: Array, task: Task, rng: np.random.Generator
) -> tuple[Member, float]:
    """A part and its size, joints, links and the pedestal equally often where they may be so soft."""
    kinds = sorted(LARGEST)
    kind = kinds[task.number % len(kinds)]
    natural = []
    for part, columns in parts:
        shift = columns[:, 0] if part.joint is not None else columns @ soft
        size = task.size * NOISE_MM / rms(shift)
        if size * 1e-6 < LARGEST[part.effect]:
            natural.append((part, size))
    of_kind = [one for one in natural if one[0].effect == kind] or natural
    return of_kind[int(rng.integers(len(of_kind)))]


def verdict(found: Sequence[set[tuple[str, int | None]]], truth: set[tuple[str, int | None]]) -> str:
    """What proven parts are worth, or sets of parts that yield alike."""
    if not found:
        return "open"
    if not all(parts & truth for parts in found):
        return "wrong"
    return "right" if all(parts <= truth for parts in found) else "right set"


def shows(columns: Array, nuisance: Array) -> bool:
    """Whether a part's yielding moves the tool otherwise than the instrument or the tool may have moved."""
    left = columns - nuisance @ (nuisance.T @ columns)
    return bool(np.linalg.norm(left) > max(0.1 * np.linalg.norm(columns), 1e-12))


def columns_of(cell: Cell, part: Member) -> Array:
    """Differences (R, K), mm, by a size of 1 of a part; of the pedestal about x and about y."""
    causes = [part.cause] if part.joint is not None else [base((1.0, 0.0)).cause, base((0.0, 1.0)).cause]
    return np.column_stack([difference_mm(cell, [(cause, 1.0)]).ravel() for cause in causes])


def nuisance_of(cell: Cell) -> Array:
    """Orthonormal directions (R, 9) of the differences by a motion of the instrument and a shift of the tool."""
    places = places_of(cell)
    here = cell.plain
    point = cell.seen(here.point)[:places]
    flange = np.einsum("ij,njk->nik", cell.scanner_T_base[0, :3, :3], here.end[-1][:places, :3, :3])
    rigid = [np.tile(axis, (places, 1)) for axis in np.eye(3)]
    rigid += [np.cross(axis, (point - point.mean(axis=0)) / 1000.0) for axis in np.eye(3)]
    rigid += [flange[:, :, k] for k in range(3)]
    u, s, _ = np.linalg.svd(np.column_stack([one.ravel() for one in rigid]), full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


def best_part(parts: Sequence[tuple[Member, Array]], nuisance: Array, xyz_mm: Array) -> tuple[str, int | None] | None:
    """The part that leads every other one and none at all by `LEAD`, the noise known; None where none does."""
    places = len(xyz_mm) // 2
    residual = (xyz_mm[places:] - xyz_mm[:places]).ravel()
    residual = (residual - nuisance @ (nuisance.T @ residual)) / (np.sqrt(2.0) * NOISE_MM)
    evidence = []
    for _, raw in parts:
        unit = raw / rms(raw)  # root mean square 1 mm a coordinate
        visible = (unit - nuisance @ (nuisance.T @ unit)) / (np.sqrt(2.0) * NOISE_MM)
        u, s, _ = np.linalg.svd(visible, full_matrices=False)
        grow = 1.0 + np.multiply.outer(SCALES_MM**2, s**2)
        along = (u.T @ residual) ** 2
        evidence.append(float(np.max(0.5 * np.sum(along * (1.0 - 1.0 / grow) - np.log(grow), axis=1))))
    order = np.argsort(evidence)[::-1]
    if evidence[order[0]] - max(evidence[order[1]], 0.0) < LEAD:
        return None
    best = parts[order[0]][0]
    return best.effect, best.joint


def main() -> None:
    """Run what is asked for, a line an arm, a size and a judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=100, help="of each arm and size")
    parser.add_argument("--nothing", type=int, default=100, help="of each arm, in which nothing gives way")
    parser.add_argument("--places", type=int, default=20)
    parser.add_argument("--seed", type=int, default=2000)
    parser.add_argument("--load-kg", type=float, default=SIZED_KG, help="measured with; sizes stay those under 2 kg")
    parser.add_argument("--arm", choices=sorted(ARMS), action="append")
    parser.add_argument("--size", type=float, action="append")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.jobs) as pool:
        for arm in asked.arm or ARMS:
            for size in asked.size or (*SIZES, 0.0):
                count = asked.cases if size else asked.nothing
                tasks = [Task(arm, size, asked.places, number, asked.seed, asked.load_kg) for number in range(count)]
                told = list(pool.map(judged, tasks, chunksize=5))
                for who, verdicts in (("bound", [b for b, _ in told]), ("calib", [c for _, c in told])):
                    counts = Counter(verdicts)
                    words = ", ".join(f"{word} {counts[word]:3}" for word in ("right", "right set", "open", "wrong"))
                    print(f"{arm:6} {size or 'nothing':>7}  {who}: {words} of {count}", flush=True)


if __name__ == "__main__":
    main()
