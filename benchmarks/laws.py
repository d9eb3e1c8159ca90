"""Laws told of causes outside the catalogue, by a second simulator: `python benchmarks/laws.py [--per-cause N] ...`.

The simulator is `tests/support/engine`, which shares no code with calib. Seventeen causes that follow a law of load,
of two joints or of the way that was gone, and others that follow none; then arms with nothing hidden, or with effects
of the catalogue alone, on which every law that is told is a false one.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd
from second_engine import results
from third_engine import interval

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, diagnose
from calib.errors import CalibError
from calib.screening.curves.laws import law_kind
from calib.screening.curves.smooth_joint_error import FormulaModes
from tests.support.engine.cases import UNFORESEEN, Case, Simulated, simulate
from tests.support.engine.classes import cases
from tests.support.engine.law_causes import FORMS

OF_NO_LAW = tuple(name for name in UNFORESEEN if name not in FORMS)
CATALOGUE_CLASSES = {"null": 2, "odd null": 1, "single": 4, "shapes": 2, "pair": 2, "odd single": 1, "new": 4}
"""Classes of sets without a cause from outside the catalogue, and how many of 16 are of each."""


def run(case: Case) -> dict[str, object]:
    """Simulate, diagnose, and note what law was told: one row."""
    row: dict[str, object] = {"kind": case.kind, "causes": case.causes, "number": case.number}
    simulated = simulate(case)
    truth = FORMS.get(case.causes[0], "") if case.kind == "law" else ""
    row |= {"sigma": max(simulated.sigmas, default=0.0), "arm": simulated.cell.arm.name, "truth": truth}
    start = time.process_time()
    try:
        found = diagnose(simulated.dataset)
    except CalibError as error:
        return row | {"verdict": f"refused: {error}", "named": (), "laws": (), "curves": False, "seconds": np.nan}
    seconds = time.process_time() - start
    members = found.learned.members if found.learned is not None else ()
    laws = [(m.joint + 1, m.modes) for m in members if isinstance(m.modes, FormulaModes)]
    told = [(joint, law_kind(joint - 1, modes)) for joint, modes in laws]
    joints = _joints_of(simulated) if truth else ()
    test = found.calibration.after.test
    geometry = calibrate(simulated.dataset).after.test
    return row | {
        "verdict": found.verdict,
        "named": found.named,
        "laws": tuple(
            f"J{joint} {kind} ({m.factor + ' x ' * bool(m.factor)}{m.input})"
            for (joint, kind), (_, m) in zip(told, laws, strict=True)
        ),
        "curves": len(members) > len(laws),
        "right": any(kind == truth and joint in joints for joint, kind in told),
        "alone": bool(told) and all(kind == truth and joint in joints for joint, kind in told),
        "removed": 1.0 - test.rmse_mm / geometry.rmse_mm if test and geometry else np.nan,
        "seconds": seconds,
    }


def _joints_of(simulated: Simulated) -> tuple[int, ...]:
    """Joints, from 1, that the hidden cause moves."""
    (cause, size), cell = simulated.causes[0], simulated.cell
    assert cause.deform is not None
    moved = cause.deform(cell, cell.plain, size).joint
    return tuple((np.flatnonzero(np.any(moved != 0.0, axis=0)) + 1).tolist())


def law_cases(per_cause: int, seed: int) -> Iterator[Case]:
    """Each cause that follows a law, on the arms in turn."""
    for c, name in enumerate(FORMS):
        yield from (Case("law", (name,), k + 3 * c, seed) for k in range(per_cause))


def other_cases(per_cause: int, seed: int) -> Iterator[Case]:
    """Causes from outside the catalogue that follow no law of a joint that is tried."""
    for c, name in enumerate(OF_NO_LAW):
        yield from (Case("no law", (name,), k + 3 * c, seed) for k in range(per_cause))


def catalogue_cases(count: int, seed: int) -> list[Case]:
    """Sets with effects of the catalogue alone, or with nothing hidden."""
    parts = sum(CATALOGUE_CLASSES.values())
    return [
        case for name, share in CATALOGUE_CLASSES.items() for case in cases(round(count * share / parts), seed, (name,))
    ]


def tell(rows: pd.DataFrame) -> None:
    """Print how many causes were told in their right form, and how many laws were told of sets without one.

    right: a law of the right form, of the right joint, is told. alone: and no other law beside it. error removed: the
    share of the error of test poses with geometry alone that is gone.
    """
    of_laws = rows[rows["kind"] == "law"]
    if len(of_laws):
        print(f"{'cause':20s}{'form':26s}{'sets':>5s}{'right':>7s}{'alone':>7s}{'curves':>8s}{'error removed':>15s}")
        for name, group in of_laws.groupby("causes", sort=False):
            print(
                f"{name[0]:20s}{FORMS[name[0]]:26s}{len(group):5d}{int(group['right'].sum()):7d}"
                f"{int(group['alone'].sum()):7d}{int(group['curves'].sum()):8d}"
                f"{100 * group['removed'].median():13.0f} %"
            )
        print(f"right form and joint: {interval(of_laws['right'].astype(bool))}")
        told = of_laws[of_laws["laws"].map(bool)]
        if len(told):
            print(f"of {len(told)} where a law is told: {interval(told['right'].astype(bool))}")
    others = rows[rows["kind"] == "no law"]
    if len(others):
        print(
            f"causes that follow none of the laws: one told for {int(others['laws'].map(bool).sum())} of {len(others)}"
        )
    clean = rows[~rows["kind"].isin(["law", "no law"])]
    if len(clean):
        told = int(clean["laws"].map(bool).sum())
        print(f"nothing hidden, or effects of the catalogue alone: a law told for {told} of {len(clean)}")
    seconds = rows["seconds"].dropna()
    print(f"processor time of a diagnosis: median {seconds.median():.2f} s, at most {seconds.max():.2f} s")


def tell_failures(rows: pd.DataFrame) -> None:
    """Print one line for each law that was missed, and for each that was told where there is none."""
    for row in rows.itertuples():
        wrong = not row.right if row.kind == "law" else bool(row.laws)
        if wrong:
            print(
                f"{row.kind} {row.number}: {' + '.join(row.causes) or 'nothing'} ({row.sigma:.1f} sigma, {row.arm}) -> "
                f"{row.verdict} {' + '.join(row.named)}; {'; '.join(row.laws) or 'no law'}{', curves' * row.curves}"
            )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--per-cause", type=int, default=4, help="sets of each cause that follows a law")
    parser.add_argument("--others", type=int, default=2, help="sets of each cause that follows none")
    parser.add_argument("--catalogue", type=int, default=64, help="sets without a cause from outside the catalogue")
    parser.add_argument("--seed", type=int, default=0, help="below 1000 for development, above for a count")
    parser.add_argument("--only", action="append", default=[], choices=list(FORMS), help="may be repeated")
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    asked = [*law_cases(options.per_cause, options.seed), *other_cases(options.others, options.seed)]
    asked += catalogue_cases(options.catalogue, options.seed)
    if options.only:
        asked = [case for case in asked if case.kind == "law" and case.causes[0] in options.only]
    start = time.perf_counter()
    rows = results(asked, options.jobs, run, None)
    tell(rows)
    tell_failures(rows)
    print(f"{len(rows)} sets in {time.perf_counter() - start:.0f} s, seed {options.seed}")


if __name__ == "__main__":
    main()
