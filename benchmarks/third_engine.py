"""Diagnoses of treacherous arms by a third simulator: `python benchmarks/third_engine.py [--per-class N] ...`.

The simulator is `tests/support/third_engine`, which shares no code with calib, nor with the second one: screws and
quaternions, weights as wrenches, datasets handed over as folders. Seeds below 1000 are for development; a count that is
to be quoted takes one from 1000 on that nobody has looked at.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd
from second_engine import asked_of, results

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, diagnose
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.result import Diagnosis
from calib.effects.catalogue import catalogue_names
from calib.errors import CalibError
from tests.support.third_engine.cases import CLASSES, Case, Simulated, cases, simulate
from tests.support.third_engine.folder import write_folder

CALM = ("adequate", "named", "outliers")
FRESH_SEED = 1000
NOT_DIAGNOSED = {
    "reason": "",
    "noise_shaped": False,
    "data_problem": False,
    "error_over_true": np.nan,
    "held_out_ratio": np.nan,
    "parameters": "[]",
    "seconds": np.nan,
}


def run(case: Case) -> dict[str, object]:
    """Simulate, diagnose, and note what was hidden and what came out: one row."""
    simulated = simulate(case)
    session = simulated.session
    row: dict[str, object] = {
        "kind": case.kind,
        "number": case.number,
        "seed": case.seed,
        "arm": session.make.name,
        "instrument": simulated.instrument,
        "poses": session.count,
        "sheet": tuple(sorted(simulated.columns)),
        "laws": tuple(cause.law for cause, _ in simulated.hidden),
        "sigmas": tuple(round(float(s), 2) for s in simulated.sigmas),
        "truth": tuple(cause.names for cause, _ in simulated.hidden),
        "outside": tuple(cause.outside or not cause.names for cause, _ in simulated.hidden),
        "every": tuple(cause.every for cause, _ in simulated.hidden),
        "noise_like": tuple(cause.noise for cause, _ in simulated.hidden),
        "sister": simulated.plan.sister,
        "undecidable": simulated.plan.undecidable,
    }
    with tempfile.TemporaryDirectory() as scratch:
        dataset = load_dataset(write_folder(simulated, Path(scratch) / "cell"))
        freed = load_dataset(write_folder(simulated, Path(scratch) / "freed", freed=True))
    start = time.process_time()
    try:
        found = diagnose(dataset)
    except CalibError as error:
        return row | {"verdict": f"refused: {error}", "missing": (), "suspected": (), "open": ()} | NOT_DIAGNOSED
    seconds = time.process_time() - start
    test, reachable = found.calibration.after.test, calibrate(freed).after.test
    return row | {
        "verdict": found.verdict,
        "missing": tuple(found.missing),
        "suspected": tuple(found.suspected),
        "open": tuple(found.ambiguous_set),
        "reason": found.conclusion.reason,
        "noise_shaped": found.noise is not None,
        "data_problem": found.data_problem is not None,
        "error_over_true": test.rmse_mm / reachable.rmse_mm if test and reachable else np.nan,
        "held_out_ratio": found.held_out.ratio if found.held_out else np.nan,
        "parameters": json.dumps(_judged_parameters(found, simulated)),
        "seconds": round(seconds, 2),
    }


def _judged_parameters(found: Diagnosis, simulated: Simulated) -> list[tuple[str, float]]:
    """Errors over their sigma of parameters whose true value is known, of the effects that are claimed."""
    known = simulated.known
    effects = {name.split(".")[0] for name in known} & set(found.missing)
    table = found.parameters
    return [
        (str(row.name), round(float((row.value - known.get(row.name, 0.0)) / row.sigma), 3))
        for row in table[table["known"].astype(bool)].itertuples(index=False)
        if str(row.name).split(".")[0] in effects and row.sigma > 0.0
    ]


def judged(row: pd.Series) -> pd.Series:
    """Judgement of a diagnosis from its row; `tell` names the columns."""
    claimed, open_set, calm = set(row["missing"]), set(row["open"]), row["verdict"] in CALM
    right = {name for names in row["truth"] for name in names}
    have = set(catalogue_names())

    def told(k: int, by: set[str]) -> bool:
        names = set(row["truth"][k])
        shaped = row["noise_like"][k] and bool(row["noise_shaped"])
        return shaped or (bool(names) and (names <= by if row["every"][k] else bool(names & by)))

    count = range(len(row["truth"]))
    asked = all(not row["outside"][k] and row["truth"][k][0] in have for k in count)
    complete = all(told(k, claimed) for k in count)
    wrong = bool(claimed - right)
    open_holds = row["verdict"] == "ambiguous" and not wrong and all(told(k, claimed | open_set) for k in count)
    if row["sister"] and row["data_problem"]:
        exact = not claimed
    elif complete and asked:
        exact = not wrong and (row["verdict"] in ("adequate", "named") if claimed or not count else calm)
    else:
        exact = not wrong and not (calm and not complete) and not asked
    exact = exact or (bool(row["undecidable"]) and open_holds)
    return pd.Series(
        {
            "exact": exact,
            "told": complete and not wrong and row["verdict"] in (CALM if count else ("adequate",)),
            "left_open": open_holds and not exact,
            "wrong_claim": wrong,
            "wrong_suspicion": bool(set(row["suspected"]) - right) or bool(open_set and not open_set & right),
            "calm_wrong": calm and (wrong or not complete),
        }
    )


COLUMNS = {
    "exact": "exact",
    "told": "told",
    "left_open": "left open",
    "wrong_claim": "wrong claim",
    "wrong_suspicion": "wrong suspect",
    "calm_wrong": "calm, wrong",
}


def interval(hits: pd.Series) -> str:
    """Share of hits with Wilson's 95 % interval: '89.0 % [85.9, 91.6]'."""
    n, share, z = len(hits), float(hits.mean()), 1.96
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return f"{100 * share:.1f} % [{100 * max(middle - half, 0.0):.1f}, {100 * min(middle + half, 1.0):.1f}]"


def tell(rows: pd.DataFrame) -> None:
    """Print how many of each class are exact, left open, wrong, and how good the figures of the right ones are.

    exact: no untrue name is claimed; and where nothing is hidden, the verdict is adequate; where all causes are effects
    of the installed catalogue, each is claimed; else what is not told is not passed over under a calm verdict. A cause
    that looks like noise is told by a shape of the noise, too. Undecidable by its data: also an open set that holds the
    truth. A table of a sister: also the finding that the table is wrong. left open: not exact, ambiguous with the truth
    in the set. told: every cause claimed by a true name under a calm verdict, whatever the catalogue has today. wrong
    suspect: an untrue name suspected, or an open set without a true one. calm, wrong: adequate, named or outliers with
    a wrong name or a cause untold.
    """
    print(
        f"{'class':16s}{'sets':>5s}" + "".join(f"{head:>15s}" for head in COLUMNS.values()) + f"{'held-out/true':>15s}"
    )
    for name in [*CLASSES, "all"]:
        group = rows if name == "all" else rows[rows["kind"] == name]
        if not len(group):
            continue
        counts = "".join(f"{int(group[column].sum()):15d}" for column in COLUMNS)
        error = group["error_over_true"].dropna()
        print(f"{name:16s}{len(group):5d}{counts}{error.median() if len(error) else np.nan:15.3f}")
    for column, head in COLUMNS.items():
        print(f"{head:14s}{interval(rows[column].astype(bool))}")
    _tell_figures(rows)
    seconds = rows["seconds"].dropna()
    if len(seconds):
        print(f"processor time of a diagnosis: median {seconds.median():.2f} s, at most {seconds.max():.2f} s")


def _tell_figures(rows: pd.DataFrame) -> None:
    """Print shares of known parameters within 1 and 2 sigma, by effect, and the held-out test, where all was told."""
    good = rows[rows["exact"].astype(bool) & rows["verdict"].isin(["adequate", "named"])]
    errors: dict[str, list[float]] = defaultdict(list)
    for text in good["parameters"].dropna():
        for name, z in json.loads(text):
            errors[name.split(".")[0]].append(abs(z))
    for effect, z in errors.items():
        within = [f"{100 * np.mean(np.array(z) < k):.0f}" for k in (1.0, 2.0)]
        print(f"{effect}: {within[0]} / {within[1]} % of {len(z)} known values within 1 / 2 sigma, worst {max(z):.1f}")
    ratio = good["held_out_ratio"].dropna()
    if len(ratio):
        print(f"held-out z^2 of a point, 3 when honest: mean {3.0 * np.mean(ratio**2):.2f} of {len(ratio)} sets")


def tell_failures(rows: pd.DataFrame) -> None:
    """Print one line for each case that is not exact."""
    for row in rows[~rows["exact"].astype(bool)].itertuples():
        hidden = " + ".join(f"{law} ({s:.1f} sigma)" for law, s in zip(row.laws, row.sigmas, strict=True)) or "nothing"
        mark = "WRONG" * row.wrong_claim or "CALM" * row.calm_wrong
        told = " ".join(
            f"{word} {', '.join(names)};"
            for word, names in (("claimed", row.missing), ("suspected", row.suspected), ("open", row.open))
            if names
        )
        at = f"{row.arm}, {row.instrument}, {row.poses} poses" + f", sister {row.sister}" * bool(row.sister)
        print(f"{mark:6s}{row.kind} {row.number}: {hidden} | {at} -> {row.verdict}: {told}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for and print."""
    seeds = f"below {FRESH_SEED} for development, above for a count"
    asked, options = asked_of(arguments, __doc__ or "", CLASSES, cases, seeds)
    start = time.perf_counter()
    rows = results(asked, options.jobs, run, judged)
    tell(rows)
    tell_failures(rows)
    print(f"{len(rows)} sets in {time.perf_counter() - start:.0f} s, seed {options.seed}")


if __name__ == "__main__":
    main()
