"""Two hours of everything that can go wrong, on two cores; a run that was stopped goes on where it was.

    python benchmarks/soak.py [--scale 0.01] [--only files|arms|constraints|invariances|clients|page]
                              [--out FOLDER] [--jobs 2] [--seed 18] [--retry]

files        10,000 spoiled inputs of every kind, each given to a command: exit code 0, 1 or 2, one bounded line on 2,
             no traceback, no warning of Python's, no hang, nothing half-written, bounded memory; a quarter of them
             mean what they meant, and have to give the same result
arms         1,000 random arms from calib/simulation/truth, diagnosed: errors against the bound, names against the truth
constraints  10,000 random arms measured by sockets, planes and bars: no fit that lost the arm's size is accepted
invariances  1,000 fits of such arms after the scanner or the rows moved, or names or units changed: the same result
clients      20 hostile clients at a live server, one by one and all at once, beside an honest one
page         5,000 operations on a page: no exception, no growing memory

A case follows from the seed and its number alone. Results stand in FOLDER/PART.jsonl, a line each; the same command
runs what is not there yet, and with --retry what was in trouble. Exit code 1 where anything was wrong.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy: one thread a process
ROOT = Path(__file__).resolve().parents[1]
for _path in (str(ROOT), str(ROOT / "benchmarks")):
    if _path not in sys.path:
        sys.path.insert(0, _path)

from soaking import pool, tell  # noqa: E402
from soaking.record import Record, Result  # noqa: E402

COUNTS = {
    "files": 10_000,
    "arms": 1000,
    "constraints": 10_000,
    "invariances": 1000,
    "clients": 21,
    "page": 5000,
}
MODULES = {
    "files": "soaking.inputs.files",
    "arms": "soaking.cells.arms",
    "constraints": "soaking.cells.constraints",
    "invariances": "soaking.cells.invariances",
}
LIMIT_S = {
    "files": 180.0,
    "arms": 300.0,
    "constraints": 300.0,
    "invariances": 300.0,
}  # for one case, on a machine that others use too
SEED = 18
TELL_EVERY_S = 60.0


def counts_at(scale: float) -> dict[str, int]:
    """Number of cases of each part; the clients are always all run, as each is another."""
    return {part: n if part == "clients" else max(1, round(n * scale)) for part, n in COUNTS.items()}


def results_of(part: str, numbers: Sequence[int], options: argparse.Namespace) -> Iterator[Result]:
    """Run these cases of a part."""
    out: Path = options.out
    if part in ("clients", "page"):
        from soaking.server import clients, page

        yield from {"clients": clients.run, "page": page.run}[part](numbers, out / part)
        return
    if part == "files":
        from soaking.inputs import material

        material.make(out / "material")
    work = pool.Work(MODULES[part], options.seed, out / "material", LIMIT_S[part])
    yield from pool.run(work, numbers, out / "scratch" / part, options.jobs)


def run_part(part: str, count: int, options: argparse.Namespace) -> list[Result]:
    """Run what is left of a part, telling of it as it goes; all its results."""
    record = Record(options.out / f"{part}.jsonl")
    step = 100 if part == "page" else 1  # of operations, the page's cases are hundreds
    numbers = range(max(1, count // step))
    left = record.left(numbers, retry=options.retry)
    began = told = time.monotonic()
    for done, result in enumerate(results_of(part, left, options) if left else (), 1):
        record.add(result)
        if result.trouble:
            print(tell.trouble_line(part, result), flush=True)
        if time.monotonic() - told > TELL_EVERY_S:
            told = time.monotonic()
            rest_s = (told - began) / done * (len(left) - done)
            print(
                f"{part}: {len(numbers) - len(left) + done} of {len(numbers)}, {rest_s / 60:.0f} min left",
                flush=True,
            )
    return record.of(numbers)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the parts and print the table; 1 where anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=[*COUNTS], help="this part; may be given several times")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the cases")
    parser.add_argument("--out", type=Path, default=Path("build/soak"), help="where the results are kept")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--retry", action="store_true", help="run again what was in trouble")
    options = parser.parse_args(arguments)
    options.out = options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    seed_file = options.out / "seed"
    if seed_file.exists() and int(seed_file.read_text()) != options.seed:
        parser.error(f"{options.out} holds results of seed {seed_file.read_text()}; name another --out or that seed")
    seed_file.write_text(str(options.seed))
    counts = counts_at(options.scale)
    found = {part: run_part(part, counts[part], options) for part in options.only or COUNTS}
    lines, good = tell.table(found)
    print("\n".join(lines))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
