"""Does the diagnosis name what is hidden, and only that? `python benchmarks/diagnosis.py [--singles N] [--nulls N] ...`

Every dataset is simulated by calib/simulation/truth, which shares no code with the diagnosis: RB5 and Panda in turn, 64
poses to train on and 16 held out, 0.05 mm noise an axis, payload, temperature, time and approach varied and written
down. The size of an effect is what a geometric fit leaves of it, rms a coordinate in sigmas of the noise. Brackets:
Wilson, 95 %.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pandas as pd
import second_engine

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import calibrate, diagnose
from calib.dataset.dataset import Dataset, Points, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.effects.catalogue import CATALOGUE, catalogue_names, effects_named
from calib.errors import CalibError
from calib.simulation.simulate import Simulation, simulate_dataset
from calib.simulation.truth.arm_sampling import OUTSIDE_EFFECTS
from calib.simulation.truth.equilibrium import scanner_T_target
from calib.simulation.truth.mechanism import Conditions

NOISE_MM = 0.05
POSES = 80  # of which 16 are held out
TESTABLE = tuple(kind.name for kind in CATALOGUE if kind.testable)
OUTSIDE = tuple(dict.fromkeys(("hose_pull", "field_bump", "rough_gear", "fine_ripple", *OUTSIDE_EFFECTS)))  # seeds
SPREAD = TESTABLE[:15]  # of every joint or pose: what is there always
PAIRS = tuple(combinations(SPREAD, 2))
SIZES = (0.5, 1.0, 3.0)
OUTSIDE_SIZES = (1.0, 3.0)
DECLARED = (1.0, 0.8, 1.2)  # declared sigma over the true one


@dataclass(frozen=True)
class Trial:
    """A dataset to diagnose; its fields are its seed, so that it is the same whatever else is run."""

    kind: str  # single, null, pair, outside
    effects: tuple[str, ...]
    size: float  # visible rms in sigmas; of each of a pair
    declared: float  # sigma
    number: int

    def simulate(self) -> Simulation:
        names = (*catalogue_names(), *OUTSIDE)
        key = [len(self.kind), *(names.index(e) for e in self.effects), int(100 * self.size), self.number]
        arm = ("rb5", "panda")[self.number % 2]
        return simulate_dataset(
            builtin_robot(arm),
            rng=np.random.default_rng(key),
            effects=self.effects,
            visible_sigmas=self.size,
            conditions=True,
            poses=POSES,
            noise_mm=NOISE_MM,
        )


def run(trial: Trial) -> dict[str, object]:
    """Simulate, diagnose, and note what came out; one row of the table that all figures are drawn from."""
    simulation = trial.simulate()
    dataset = replace(simulation.dataset, scanner=Scanner(point_sigma_mm=NOISE_MM * trial.declared))
    start = time.perf_counter()
    try:
        diagnosis = diagnose(dataset)
    except CalibError as error:
        return asdict(trial) | {"verdict": f"refused: {error}"}
    seconds = time.perf_counter() - start
    candidates = diagnosis.candidates
    test = diagnosis.calibration.after.test
    return asdict(trial) | {
        "arm": dataset.robot.name,
        "verdict": diagnosis.verdict,
        "missing": diagnosis.missing,
        "suspected": diagnosis.suspected,
        "ambiguous": diagnosis.ambiguous_set,
        "first": candidates[0].name if candidates else "",
        "structured": diagnosis.residual_tests.structured,
        "test_mm": test.rmse_mm if test else np.nan,
        "geometry_test_mm": diagnosis.steps[0].calibration.after.test.rmse_mm,
        "best_test_mm": reachable(simulation) if trial.effects else np.nan,
        "wrong_test_mm": with_wrong(trial, dataset) if trial.kind == "single" else np.nan,
        "seconds": seconds,
    }


def reachable(simulation: Simulation) -> float:
    """Held-out error of a geometric fit to points that are freed of the true effect: the best that naming it can do."""
    truth, dataset = simulation.truth, simulation.dataset
    points = dataset.points
    assert points is not None
    plain_mm = scanner_T_target(truth.with_effects(), dataset.poses.q, Conditions.of(dataset.poses))[:, :3, 3]
    freed = points.xyz_mm - (simulation.apex_mm - plain_mm)[points.pose]
    test = calibrate(replace(dataset, points=Points(points.pose, freed, points.target))).after.test
    return test.rmse_mm if test else np.nan


def with_wrong(trial: Trial, dataset: Dataset) -> float:
    """Held-out error after adding an effect by hand that is not there, drawn from the others."""
    others = [name for name in SPREAD if name not in trial.effects]
    wrong = others[(TESTABLE.index(trial.effects[0]) + 7 * trial.number) % len(others)]
    test = calibrate(dataset, effects=effects_named(dataset, [wrong])).after.test
    return test.rmse_mm if test else np.nan


def trials(singles: int, nulls: int, pairs: int, outside: int) -> list[Trial]:
    """Everything that is asked for; `pairs` are drawn from all pairs in a fixed order."""
    out = [Trial("single", (e,), size, 1.0, k) for size in SIZES for e in TESTABLE for k in range(singles)]
    out += [Trial("null", (), 0.0, declared, k) for declared in DECLARED for k in range(nulls)]
    order = np.random.default_rng(0).permutation(len(PAIRS))
    out += [Trial("pair", PAIRS[order[k % len(PAIRS)]], 3.0, 1.0, k) for k in range(pairs)]
    out += [Trial("outside", (e,), size, 1.0, k) for size in OUTSIDE_SIZES for e in OUTSIDE for k in range(outside)]
    return out


def share(hits: Iterable[bool]) -> str:
    """'96.0 % [93.1, 97.8] of 300' with Wilson's interval at 95 %."""
    values = np.array(list(hits), dtype=bool)
    n = len(values)
    if n == 0:
        return "none"
    p, z = float(values.mean()), 1.96
    middle, half = p + z * z / (2 * n), z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = np.array([middle - half, middle + half]) / (1 + z * z / n)
    return f"{100 * p:5.1f} % [{100 * max(low, 0.0):.1f}, {100 * min(high, 1.0):.1f}] of {n}"


def tell(rows: pd.DataFrame) -> None:
    """Print every table for which there are rows."""
    for kind, table in (
        ("single", tell_singles),
        ("null", tell_nulls),
        ("pair", tell_pairs),
        ("outside", tell_outside),
    ):
        of_kind = rows[rows["kind"] == kind]
        if len(of_kind):
            table(of_kind)
    middle, high = rows["seconds"].quantile([0.5, 0.95])
    print(f"time of a diagnosis: median {middle:.2f} s, 95 % below {high:.2f} s")


def tell_singles(rows: pd.DataFrame) -> None:
    """Right name first, precision, held-out error, confusion matrix."""
    print("one hidden effect")
    for size, of_size in rows.groupby("size"):
        right = np.array([r.effects[0] for r in of_size.itertuples()])
        first = of_size["first"].to_numpy() == right
        claims = of_size[(of_size["verdict"] == "named") & (of_size["missing"].map(len) == 1)]
        exact = np.array([r.missing == r.effects for r in claims.itertuples()], dtype=bool)
        any_wrong = [bool(set(r.missing) - set(r.effects)) for r in of_size.itertuples()]
        kept = [r.effects[0] in (*r.missing, *r.ambiguous) for r in of_size.itertuples()]
        print(f"  visible {size:g} sigma: right name first {share(first)}")
        print(f"     named or in the ambiguous set {share(kept)};  any wrong name claimed {share(any_wrong)}")
        print(f"     verdict 'named' with one name: {len(claims)} times, right {share(exact)}")
        named = claims[exact] if len(claims) else claims
        ratio = (named["test_mm"] / named["best_test_mm"]).to_numpy()
        gain = (named["test_mm"] / named["geometry_test_mm"]).to_numpy()
        if len(ratio):
            print(f"     held-out error with the right name: {np.median(gain):.2f} of the geometric fit's (median);")
            middle, high = np.quantile(ratio, [0.5, 0.95])
            print(f"     over the reachable one: median {middle:.3f}, 95 % below {high:.3f};")
            print(f"     within 5 % of it {share(ratio < 1.05)}")
        wrong = (of_size["wrong_test_mm"] / of_size["geometry_test_mm"]).to_numpy()
        print(
            f"     a wrong effect added by hand: held-out error {np.median(wrong):.3f} of the geometric fit's (median)"
        )
        print(f"     verdicts: {counted(of_size['verdict'])}")
        sets = Counter(" / ".join(sorted(r.ambiguous)) for r in of_size.itertuples() if r.ambiguous)
        for open_set, count in sets.most_common(6):
            print(f"     left open {count} times: {open_set}")
    tell_confusion(rows)


def tell_confusion(rows: pd.DataFrame) -> None:
    """Print the confusion matrix over all sizes: hidden effects in rows, first candidates in columns; wrong claims."""
    head = "".join(f"{i + 1:4d}" for i in range(len(TESTABLE)))
    print(f"  {'hidden (row), ranked first (column)':38s}{head}")
    for i, name in enumerate(TESTABLE):
        of_name = rows[[effects == (name,) for effects in rows["effects"]]]
        first = Counter(of_name["first"])
        cells = "".join(f"{first[other] or '.':>4}" for other in TESTABLE)
        named = sum(r.verdict == "named" and r.missing == r.effects for r in of_name.itertuples())
        wrong = Counter(m for r in of_name.itertuples() for m in r.missing if m not in r.effects)
        note = f"   wrongly: {', '.join(f'{k} {v}' for k, v in wrong.items())}" if wrong else ""
        print(f"  {i + 1:2d} {name:20s} named {named:3d}/{len(of_name):<4d}{cells}{note}")


def tell_nulls(rows: pd.DataFrame) -> None:
    """Print how often a cause is named or suggested where nothing is hidden."""
    print("nothing hidden")
    for declared, of_sigma in rows.groupby("declared"):
        alarm = [bool(r.missing or r.ambiguous) for r in of_sigma.itertuples()]
        print(f"  declared sigma {declared:g} times the true one: a cause named or suggested {share(alarm)}")
        print(f"     not 'adequate' {share(of_sigma['verdict'] != 'adequate')};  {counted(of_sigma['verdict'])}")


def tell_pairs(rows: pd.DataFrame) -> None:
    """Print how often two hidden effects are found."""
    exact = [set(r.missing) == set(r.effects) for r in rows.itertuples()]
    wrong = [bool(set(r.missing) - set(r.effects)) for r in rows.itertuples()]
    certain = rows[rows["verdict"] == "named"]
    print(f"two hidden effects, each visible {rows['size'].iloc[0]:g} sigma: exactly the right set {share(exact)}")
    print(f"  any wrong name claimed {share(wrong)};  verdicts: {counted(rows['verdict'])}")
    print(
        f"  where the verdict is 'named': right {share(set(r.missing) == set(r.effects) for r in certain.itertuples())}"
    )
    failed = rows[[not hit for hit in exact]]
    for row in failed.head(12).itertuples():
        told = f"{row.missing} {row.suspected or ''} {row.ambiguous or ''}"
        print(f"     {' + '.join(row.effects)}: {row.verdict}, {told}")


def tell_outside(rows: pd.DataFrame) -> None:
    """A cause that the catalogue lacks: 'named' and 'adequate' are both false satisfaction."""
    print("a cause outside the catalogue")
    for size, of_size in rows.groupby("size"):
        satisfied = of_size["verdict"].isin(["named", "adequate"])
        print(f"  visible {size:g} sigma: falsely satisfied {share(satisfied)}")
        for (effect,), of_effect in of_size.groupby("effects"):
            here = of_effect["verdict"].isin(["named", "adequate"])
            names = Counter(" + ".join(m) for m in of_effect["missing"] if m)
            told = f"  claimed: {', '.join(f'{k} {v}' for k, v in names.most_common(4))}" if names else ""
            print(f"     {effect:16s} {share(here)}   {counted(of_effect['verdict'])}{told}")


def counted(values: pd.Series) -> str:
    """'named 30, ambiguous 4'"""
    return ", ".join(f"{value} {count}" for value, count in Counter(values).most_common())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is asked for and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--singles", type=int, default=3, help="datasets for each family and size")
    parser.add_argument("--nulls", type=int, default=25, help="datasets with nothing hidden, each declared sigma")
    parser.add_argument("--pairs", type=int, default=30, help="datasets with two effects of 3 sigma")
    parser.add_argument("--outside", type=int, default=4, help="datasets for each cause and size")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    asked = trials(options.singles, options.nulls, options.pairs, options.outside)
    start = time.perf_counter()
    rows = second_engine.results(asked, options.processes, run, None)
    refused = rows[rows["verdict"].str.startswith("refused")]
    if len(refused):
        print(f"{len(refused)} datasets were refused, the first: {refused['verdict'].iloc[0]}")
    tell(rows.drop(index=refused.index))
    print(f"{len(rows)} datasets in {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
