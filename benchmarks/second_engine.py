"""Diagnoses of arms by a second simulator: `python benchmarks/second_engine.py [--per-class N] [--only CLASS] ...`.

The simulator is `tests/support/engine`, which shares no code with calib: eight makes of arms and random ones, on floor,
wall and ceiling, with causes from the catalogue, from outside it, none, and noise that is not white. A name in
`missing` is a claim.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, diagnose
from calib.dataset.dataset import Points
from calib.errors import CalibError
from tests.support.engine.cases import UNFORESEEN, Case, Simulated, simulate
from tests.support.engine.classes import CLASSES, cases

ALSO_RIGHT = {
    "late_clock": {"following_error"},
    "unwritten_backlash": {"path_friction"},  # the way that a joint came by, from the order of the poses
    "creeping_joint": {"joint_compliance"},  # slow, but a joint that gives way
    "saturating_spring": {"nonlinear_stiffness", "joint_compliance"},
}
"""Names of the catalogue that are true of a cause that it lacks, too."""
SATISFIED = ("adequate", "named")


def run(case: Case) -> dict[str, object]:
    """Simulate, diagnose, and note what came out: one row."""
    simulated = simulate(case)
    row: dict[str, object] = asdict(case) | {"sigmas": simulated.sigmas, "arm": simulated.cell.arm.name}
    start = time.process_time()
    try:
        found = diagnose(simulated.dataset)
    except CalibError as error:
        return row | {"verdict": f"refused: {error}", "missing": (), "suspected": (), "open": ()}
    seconds = time.process_time() - start
    test = found.calibration.after.test
    reachable = _reachable(simulated)
    return row | {
        "verdict": found.verdict,
        "missing": tuple(found.missing),
        "suspected": tuple(getattr(found, "suspected", ())),
        "open": tuple(found.ambiguous_set),
        "error_over_true": test.rmse_mm / reachable if test and reachable else np.nan,
        "seconds": seconds,
    }


def _reachable(simulated: Simulated) -> float:
    """Held-out error, mm, of a geometric fit to points freed of their causes: what the true model comes to."""
    points = simulated.dataset.points
    assert points is not None
    freed = Points(points.pose, simulated.freed_mm, points.target)
    test = calibrate(replace(simulated.dataset, points=freed)).after.test
    return test.rmse_mm if test else np.nan


def judged(row: pd.Series) -> pd.Series:
    """Judgement of a diagnosis from its row; `tell` names the classes."""
    claimed, open_set, hidden = set(row["missing"]), set(row["open"]), set(row["causes"])
    outside = bool(hidden & set(UNFORESEEN))
    right = hidden | ALSO_RIGHT.get(row["causes"][0], set()) if outside else hidden
    satisfied = row["verdict"] in SATISFIED
    left_open = row["verdict"] == "ambiguous" and hidden <= claimed | open_set and claimed <= hidden
    if not hidden:
        exact = row["verdict"] == "adequate"
    elif outside:
        exact = claimed <= right and (bool(claimed) or row["verdict"] not in SATISFIED)
    else:
        exact = claimed == hidden or (row["undecidable"] and left_open)
    return pd.Series(
        {
            "exact": exact,
            "left_open": left_open and not exact,
            "wrong_claim": bool(claimed - right),
            "wrong_suspicion": bool(set(row["suspected"]) - right),
            "falsely_satisfied": bool(hidden) and satisfied and not (claimed & right if outside else hidden <= claimed),
        }
    )


COLUMNS = ("exact", "left_open", "wrong_claim", "wrong_suspicion", "falsely_satisfied")


def tell(rows: pd.DataFrame) -> None:
    """Print the shares of each class, in percent.

    exact: the claimed set is the hidden one; no cause: the verdict is adequate; a cause that has no name: no wrong one
    is claimed, and the verdict is not calm; undecidable by its data: also an open set that holds it. left open: not
    exact, ambiguous with the truth in the set. calm, wrong: adequate or named without the truth.
    """
    head = ("exact", "left open", "wrong claim", "wrong suspect", "calm, wrong")
    print(f"{'class':14s}{'sets':>5s}" + "".join(f"{h:>15s}" for h in head) + f"{'held-out over true':>20s}")
    groups = [(name, rows[rows["kind"] == name]) for name in CLASSES]
    for name, group in [*groups, ("all", rows)]:
        if not len(group):
            continue
        shares = "".join(f"{100 * group[c].mean():13.1f} %" for c in COLUMNS)
        error = group["error_over_true"].dropna().to_numpy()
        quantiles = np.quantile(error, [0.5, 0.9]) if len(error) else (np.nan, np.nan)
        print(f"{name:14s}{len(group):5d}{shares}{quantiles[0]:11.3f}{quantiles[1]:8.2f}")
    odd = rows[rows["kind"].str.startswith("odd")]
    for noise, group in odd.groupby("noise"):
        nulls, hiding = group[group["kind"] == "odd null"], group[group["kind"] == "odd single"]
        print(
            f"   noise {noise}: clean arms adequate {nulls['exact'].sum()} of {len(nulls)}, "
            f"exact with a cause {hiding['exact'].sum()} of {len(hiding)}"
        )
    seconds = rows["seconds"].dropna()
    print(f"processor time of a diagnosis: median {seconds.median():.2f} s, at most {seconds.max():.2f} s")


def tell_failures(rows: pd.DataFrame) -> None:
    """Print one line for each case that is not exact."""
    for row in rows[~rows["exact"].astype(bool)].itertuples():
        sizes = " ".join(f"{s:.1f}" for s in row.sigmas) + " sigma, " if row.sigmas else ""
        said = f"{row.verdict} {' + '.join(row.missing)}"
        more = "".join(
            f"; {word} {', '.join(names)}"
            for word, names in (("suspected", row.suspected), ("open", row.open))
            if names
        )
        mark = "WRONG " if row.wrong_claim else "CALM  " if row.falsely_satisfied else "      "
        shape = f"{row.poses} poses" if row.poses != 80 else ""
        print(
            f"{mark}{row.kind} {row.number}: {' + '.join(row.causes) or 'nothing'} ({sizes}{row.arm}, "
            f"{row.noise} {shape}) -> {said}{more}"
        )


C = TypeVar("C")


def results(
    asked: Sequence[C],
    jobs: int = 1,
    run: Callable[[C], dict[str, object]] = run,
    judged: Callable[[pd.Series], pd.Series] | None = judged,
) -> pd.DataFrame:
    """Rows of all cases, judged unless there is nothing to judge them by."""
    with ExitStack() as stack:
        pool = stack.enter_context(ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))) if jobs > 1 else None
        done = pool.map(run, asked, chunksize=2) if pool else map(run, asked)
        found = []
        for row in done:
            found.append(row)
            if sys.stderr.isatty():
                print(f"\r{len(found)} of {len(asked)}", end="", file=sys.stderr)
    rows = pd.DataFrame(found)
    return rows if judged is None else pd.concat([rows, rows.apply(judged, axis=1)], axis=1)


def asked_of(
    arguments: Sequence[str] | None,
    about: str,
    classes: Collection[str],
    cases: Callable[..., list[C]],
    seeds: str = "",
) -> tuple[list[C], argparse.Namespace]:
    """Cases that a command line asks for, and its options."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--per-class", type=int, help="sets in each class; default: the standard run")
    parser.add_argument("--seed", type=int, default=0, help=seeds)
    parser.add_argument("--only", action="append", default=[], choices=list(classes), help="may be repeated")
    parser.add_argument("--number", type=int, help="only this one of the class")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    asked = cases(options.per_class, options.seed, tuple(options.only))
    return [case for case in asked if options.number in (None, getattr(case, "number", None))], options


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for and print."""
    asked, options = asked_of(arguments, __doc__ or "", CLASSES, cases)
    start = time.perf_counter()
    rows = results(asked, options.jobs)
    tell(rows)
    tell_failures(rows)
    print(f"{len(rows)} sets in {time.perf_counter() - start:.0f} s, seed {options.seed}")


if __name__ == "__main__":
    main()
