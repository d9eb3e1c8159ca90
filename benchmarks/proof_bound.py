"""What pairs could prove at best: `python benchmarks/proof_bound.py [--pool N] [--pairs N ...] [--load-kg X ...]`.

The poses are the best of thousands, chosen (greedily, then by exchange) with the true parts of the arm known. The
detector is brute force: it knows the noise, that exactly one joint, link or the pedestal gives way, and what each would
do; it calls a part where that leads the next by 3 in log evidence. Arms, parts and sizes are those of
`intervention.py`; nothing here is calib's but the exchange of poses. What calib plans and proves is held against it.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from intervention import SIZED_KG, Task, best_part, columns_of, loaded, nuisance_of, part_that_yields, shows
from simulated import NOISE_MM

from calib.array_types import Array, IndexArray
from calib.extras.proof_plan.simulated_pairs import PairQuestion
from calib.planning.exchange import best_poses
from tests.support.engine.cell import Cell
from tests.support.paired_cell import ARMS, Member, base, draw_pairs, members_of

_CAUSES = 60  # that poses are chosen for
_EXCHANGED = 40  # pairs, up to which exchanges follow the greedy choice
_LEVER_MM = 1000.0


def of_pairs(cell: Cell, rows: IndexArray) -> Cell:
    """The cell with some of its places alone."""
    both = np.concatenate([rows, rows + cell.poses // 2])
    return replace(
        cell,
        q=cell.q[both],
        payload_kg=cell.payload_kg[both],
        temperature_c=cell.temperature_c[both],
        time_s=cell.time_s[both],
        approach=cell.approach[both],
        setup=cell.setup[both],
    )


def free_motions(cell: Cell) -> Array:
    """Columns (N, 3, 9) of the differences by a motion of the instrument and a shift of the tool, at each place."""
    places, here = cell.poses // 2, cell.plain
    point = cell.seen(here.point)[:places]
    out = np.zeros((places, 3, 9))
    out[:, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        out[:, :, 3 + k] = np.cross(axis, (point - point.mean(axis=0)) / _LEVER_MM)
    out[:, :, 6:] = np.einsum("ij,njk->nik", cell.scanner_T_base[0, :3, :3], here.end[-1][:places, :3, :3])
    return out


def best_pairs(
    cell: Cell, parts: list[tuple[Member, Array]], drawn: list[tuple[Member, float, Array]], count: int
) -> IndexArray:
    """The places at which it shows best which part gives way, for parts drawn with their sizes."""
    places, sigma_mm = cell.poses // 2, np.sqrt(2.0) * NOISE_MM
    columns = [of_part.reshape(places, 3, -1) for _, of_part in parts]
    owner = np.repeat(np.arange(len(parts)), [one.shape[2] for one in columns])
    number = {(part.effect, part.joint): k for k, (part, _) in enumerate(parts)}
    causes = np.zeros((len(drawn), len(owner)))
    for row, (part, size, soft) in zip(causes, drawn, strict=True):
        row[owner == number[part.effect, part.joint]] = size * (soft if part.joint is None else np.ones(1))
    every = np.concatenate([free_motions(cell), *columns], axis=2) / sigma_mm
    question = PairQuestion.of(every, np.concatenate([np.full(9, -1), owner]), causes)
    return best_poses([question], count, exchange=count <= _EXCHANGED).rows


def settled(arm: str, size: float, pool: int, pairs: int, load_kg: float, cases: int, seed: int) -> tuple[float, float]:
    """Shares of cases that the bound proves rightly and wrongly."""
    rng = np.random.default_rng([seed, list(ARMS).index(arm)])
    usual = draw_pairs(ARMS[arm], rng, pool, (0.0, SIZED_KG))
    heavy = loaded(usual, load_kg)
    soft = np.ones(2)
    parts = [(part, columns_of(heavy, part)) for part in [*members_of(ARMS[arm]), base(soft)]]
    parts = [(part, columns) for part, columns in parts if shows(columns, nuisance_of(heavy))]
    sized = [(part, columns_of(usual, part)) for part, _ in parts]

    def draw(number: int) -> tuple[Member, float, Array]:
        softness = rng.uniform(0.5, 1.5, 2)
        part, times = part_that_yields(sized, softness, Task(arm, size, pairs, number, seed), rng)
        return part, times, softness

    cell = of_pairs(heavy, best_pairs(heavy, parts, [draw(number) for number in range(_CAUSES)], pairs))
    nuisance = nuisance_of(cell)
    parts = [(part, columns_of(cell, part)) for part, _ in parts]
    by_name = {(part.effect, part.joint): columns for part, columns in parts}
    right = wrong = 0
    for number in range(cases):
        part, times, softness = draw(number)
        truth = (part.effect, part.joint)
        moved = times * by_name[truth] @ (softness if part.joint is None else np.ones(1))
        after = moved.reshape(-1, 3) + np.sqrt(2.0) * NOISE_MM * rng.standard_normal((pairs, 3))
        found = best_part(parts, nuisance, np.concatenate([np.zeros_like(after), after]))
        right += found == truth
        wrong += found not in (truth, None)
    return right / cases, wrong / cases


def main() -> None:
    """Run what is asked for, a line an arm, a size, a number of pairs and a load."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pool", type=int, default=5000, help="random places that the best are chosen from")
    parser.add_argument("--pairs", type=int, nargs="+", default=[20, 60, 100])
    parser.add_argument("--load-kg", type=float, nargs="+", default=[2.0, 3.0, 5.0, 10.0])
    parser.add_argument("--size", type=float, nargs="+", default=[1.0, 2.0])
    parser.add_argument("--cases", type=int, default=600)
    parser.add_argument("--arm", choices=sorted(ARMS), action="append")
    parser.add_argument("--seed", type=int, default=11)
    asked = parser.parse_args()
    for arm in asked.arm or ARMS:
        for size in asked.size:
            for pairs in asked.pairs:
                for load_kg in asked.load_kg:
                    right, wrong = settled(arm, size, asked.pool, pairs, load_kg, asked.cases, asked.seed)
                    print(
                        f"{arm:6} {size:g}  {pairs:3} pairs, {load_kg:4g} kg: {right:.2f}, wrong {wrong:.3f}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
