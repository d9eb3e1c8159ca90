"""Probabilities of causes against what was hidden: learned on simulated arms, judged on others.

    python benchmarks/probabilities.py [--jobs N] [--keep FOLDER] [--seed S] [--learn S ...] [--renew]

Arms of three simulators: `tests/support/engine` (second), `tests/support/third_engine` (third) and calib's own (own);
the latter's truth and the two engines share no code with the diagnosis. Judged is, for each cause told at 1 % or more,
whether it was hidden: a name is true where the engine accepts it for a hidden cause, "unknown" where a hidden cause is
neither told nor among the sets. Printed: by engine and class, the expected calibration error (mean absolute difference
of told and true shares in ten bins, weighted by their counts, and what chance alone would leave of it), and how many of
the causes told at 0.9 or more are true.

--learn: seeds on which the weights are learned anew. --renew: write these weights, and the picture of docs/method.
--keep: folder of diagnoses, which later runs take from there.
"""

from __future__ import annotations

import argparse
import os
import pickle
import sys
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one thread a process
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import diagnosis as own
import numpy as np
import second_engine
from scipy.optimize import minimize

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from calib import diagnose
from calib.array_types import Array
from calib.dataset.dataset import Dataset, Scanner
from calib.dataset.files.folder import load_dataset
from calib.diagnosis.probabilities import UNKNOWN, CauseOption, cause_probabilities, questions
from calib.diagnosis.result import Diagnosis
from calib.errors import CalibError
from tests.support.engine import cases as engine
from tests.support.engine.classes import cases as second_cases
from tests.support.third_engine import cases as third
from tests.support.third_engine.folder import write_folder

ROOT = Path(__file__).resolve().parents[1]
WEIGHTS_FILE = ROOT / "calib" / "diagnosis" / "probability_weights.py"
PICTURE = ROOT / "docs" / "pictures" / "reliability.svg"
LEARN, JUDGE = (21, 22), 1031  # seeds
RIDGE = 0.3  # precision of the weights' prior, about zero
LEAST_TOLD = 0.01  # probability from which a cause is told
BINS = np.linspace(0.0, 1.0, 11)


@dataclass(frozen=True)
class Hidden:
    """A hidden cause: the names that are true of it, none for one outside the catalogue."""

    names: tuple[str, ...]
    like_noise: bool = False  # a shape of the noise tells it, too


@dataclass(frozen=True)
class Judged:
    """A diagnosis beside what was hidden."""

    engine: str
    kind: str
    hidden: tuple[Hidden, ...]
    found: Diagnosis


@dataclass(frozen=True)
class Case:
    """A dataset to simulate and diagnose."""

    engine: str
    kind: str
    number: int
    seed: int
    of_engine: engine.Case | third.Case | own.Trial

    @property
    def file_name(self) -> str:
        return f"{self.engine}_{self.seed}_{self.kind.replace(' ', '-')}_{self.number}.z"

    def simulated(self) -> tuple[Dataset, tuple[Hidden, ...]]:
        """The dataset and what is hidden in it."""
        case = self.of_engine
        if isinstance(case, own.Trial):
            dataset = case.simulate().dataset
            scanner = Scanner(point_sigma_mm=own.NOISE_MM * case.declared)
            hidden = [Hidden(() if case.kind == "outside" else (name,)) for name in case.effects]
            return replace(dataset, scanner=scanner), tuple(hidden)
        if isinstance(case, engine.Case):
            known = {law: tuple(second_engine.ALSO_RIGHT.get(law, ())) for law in engine.UNFORESEEN}
            return engine.simulate(case).dataset, tuple(Hidden(known.get(law, (law,))) for law in case.causes)
        simulated = third.simulate(case)
        told: list[Hidden] = []
        for cause, _ in simulated.hidden:
            sets = [(name,) for name in cause.names] if cause.every else [tuple(cause.names)]
            told += [Hidden(names, cause.noise) for names in sets or [()]]
        with tempfile.TemporaryDirectory() as scratch:
            return load_dataset(write_folder(simulated, Path(scratch) / "cell")), tuple(told)


def cases(seed: int) -> Iterator[Case]:
    """A standard run of the second and the third engine, and a smaller one of calib's own simulator."""
    for case in second_cases(None, seed):
        yield Case("second", case.kind, case.number, seed, case)
    for case in third.cases(None, seed):
        yield Case("third", case.kind, case.number, seed, case)
    for k, name in enumerate(own.TESTABLE):
        yield Case("own", "single", k, seed, own.Trial("single", (name,), own.SIZES[(k + seed) % 3], 1.0, seed + k))
    for k in range(24):
        yield Case("own", "null", k, seed, own.Trial("null", (), 0.0, own.DECLARED[k % 3], seed + k))
    order = np.random.default_rng(seed).permutation(len(own.PAIRS))
    for k in range(16):
        yield Case("own", "pair", k, seed, own.Trial("pair", own.PAIRS[order[k]], 3.0, 1.0, seed + k))
    for k in range(2 * len(own.OUTSIDE)):
        trial = own.Trial("outside", (own.OUTSIDE[k // 2],), own.OUTSIDE_SIZES[k % 2], 1.0, seed + k)
        yield Case("own", "outside", k, seed, trial)


def judged(case: Case, keep: Path | None) -> Judged | None:
    """Diagnosis of a case; None where the dataset is refused."""
    file = None if keep is None else keep / case.file_name
    if file is not None and file.exists():
        return pickle.loads(zlib.decompress(file.read_bytes()))
    try:
        dataset, hidden = case.simulated()
        out = Judged(case.engine, case.kind, hidden, diagnose(dataset))
    except CalibError as error:
        print(f"{case.file_name}: {error}", file=sys.stderr)
        return None
    if file is not None:
        file.write_bytes(zlib.compress(pickle.dumps(out), 1))
    return out


# ---- truth ----------------------------------------------------------------------------------------------------------


def true_answers(one: Judged) -> tuple[str, ...]:
    """The true answer to each question that a diagnosis leaves: a cause, "" or "unknown"."""
    asked = questions(one.found)
    left = [h for h in one.hidden if not (h.like_noise and one.found.noise is not None)]
    out: list[str] = []
    for name, answers in zip(one.found.named, asked, strict=False):
        mine = next((h for h in left if name in h.names), None)
        is_again = any(name in h.names for h in one.hidden)
        if mine is not None:
            left.remove(mine)
        out.append(name if is_again else UNKNOWN if answers else "")
    for k, (name, answers) in enumerate(zip(one.found.named, asked, strict=False)):
        if out[k] == name:
            continue
        options = {answer.cause for answer in answers}
        true = next(((h, sorted(options & set(h.names))) for h in left if options & set(h.names)), None)
        if true is not None:
            left.remove(true[0])
            out[k] = true[1][0]
        else:
            out[k] = UNKNOWN if left else ""
    options = {answer.cause for answer in asked[-1]}
    known = next((sorted(options & set(h.names))[0] for h in left if options & set(h.names)), None)
    taken = UNKNOWN in out and len(left) <= out.count(UNKNOWN)
    out.append(known or (UNKNOWN if left and not taken else ""))
    return tuple(out)


def true_causes(one: Judged) -> set[str]:
    """Names that are true of what is hidden, and "unknown" where something hidden is among none of the answers."""
    named = {name for h in one.hidden for name in h.names}
    return named | ({UNKNOWN} if UNKNOWN in true_answers(one) else set())


# ---- learning -------------------------------------------------------------------------------------------------------


def learned(found: Sequence[Judged]) -> dict[str, float]:
    """Weights of highest posterior probability: conditional logit over all questions, with a normal prior."""
    asked: list[tuple[tuple[CauseOption, ...], int]] = []
    for one in found:
        for answers, true in zip(questions(one.found), true_answers(one), strict=True):
            asked.append((answers, [answer.cause for answer in answers].index(true)))
    names = sorted({name for answers, _ in asked for answer in answers for name in answer.facts})
    index = {name: k for k, name in enumerate(names)}
    rows = np.concatenate([[_row(answer.facts, index) for answer in answers] for answers, _ in asked])
    starts = np.cumsum([0, *(len(answers) for answers, _ in asked)])
    chosen = starts[:-1] + np.array([true for _, true in asked])

    def surprise(weights: Array) -> tuple[float, Array]:
        scores = rows @ weights
        top = np.maximum.reduceat(scores, starts[:-1])
        p = np.exp(scores - np.repeat(top, np.diff(starts)))
        total = np.add.reduceat(p, starts[:-1])
        p /= np.repeat(total, np.diff(starts))
        value = float(np.sum(np.log(total) + top) - scores[chosen].sum() + 0.5 * RIDGE * weights @ weights)
        return value, rows.T @ p - rows[chosen].sum(axis=0) + RIDGE * weights

    best = minimize(surprise, np.zeros(len(names)), jac=True, method="L-BFGS-B", options={"maxiter": 2000})
    return {name: round(float(best.x[k]), 3) for name, k in index.items()}


def _row(facts: Mapping[str, float], index: Mapping[str, int]) -> Array:
    row = np.zeros(len(index))
    for name, value in facts.items():
        row[index[name]] = value
    return row


# ---- judging --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Told:
    """A cause told with its probability, and whether it is true."""

    engine: str
    kind: str
    cause: str
    p: float
    is_true: bool


def told(found: Sequence[Judged], weights: Mapping[str, float] | None) -> list[Told]:
    """Causes told at `LEAST_TOLD` or more."""
    out = []
    for one in found:
        true = true_causes(one)
        for cause, p in cause_probabilities(one.found, weights).causes.items():
            if p >= LEAST_TOLD:
                out.append(Told(one.engine, one.kind, cause, p, cause in true))
    return out


def calibration_error(p: Array, is_true: Array) -> float:
    """Expected calibration error over ten bins."""
    of = np.clip(np.digitize(p, BINS) - 1, 0, 9)
    return float(sum(abs(np.sum(p[of == k] - is_true[of == k])) for k in range(10)) / len(p))


def by_chance(p: Array) -> float:
    """Mean expected calibration error of probabilities that are exactly right."""
    rng = np.random.default_rng(0)
    return float(np.mean([calibration_error(p, rng.random(len(p)) < p) for _ in range(400)]))


def line(name: str, rows: Sequence[Told]) -> str:
    """Figures of some told causes."""
    p, true = np.array([r.p for r in rows]), np.array([r.is_true for r in rows], dtype=float)
    sure = p >= 0.9
    of_sure = f"{int(true[sure].sum())} of {int(sure.sum())}" if sure.any() else "none"
    brier = np.mean((p - true) ** 2)
    return (
        f"{name:24s}{len(rows):6d} told, error {calibration_error(p, true):.3f} (by chance {by_chance(p):.3f}), "
        f"mean square {brier:.3f}; told at 0.9: {of_sure} true"
    )


def tell(rows: Sequence[Told]) -> None:
    """Print calibration by engine and class, and of "unknown" alone."""
    print(line("all", rows))
    print(line("names", [r for r in rows if r.cause != UNKNOWN]))
    print(line("unknown", [r for r in rows if r.cause == UNKNOWN]))
    for name in ("second", "third", "own"):
        of = [r for r in rows if r.engine == name]
        if of:
            print(line(name, of))
        for kind in dict.fromkeys(r.kind for r in of):
            print("  " + line(kind, [r for r in of if r.kind == kind]))
    p, true = np.array([r.p for r in rows]), np.array([r.is_true for r in rows])
    for low, high in pairwise(BINS):
        inside = (p >= low) & (p < high if high < 1.0 else p <= 1.0)
        if inside.any():
            shares = f"{p[inside].mean():.3f} told, {true[inside].mean():.3f} true"
            print(f"  {low:.1f} to {high:.1f}: {int(inside.sum()):5d} causes, {shares}")


def all_judged(seeds: Sequence[int], jobs: int, keep: Path | None) -> list[Judged]:
    """Diagnoses of all cases of some seeds."""
    asked = [case for seed in seeds for case in cases(seed)]
    if jobs < 2:
        found = [judged(case, keep) for case in asked]
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(judged, asked, [keep] * len(asked), chunksize=2))
    return [one for one in found if one is not None]


# ---- what is written ------------------------------------------------------------------------------------------------


def write_weights(weights: Mapping[str, float]) -> None:
    """Write the module of weights."""
    lines = [f'        "{name}": {value:g},' for name, value in weights.items() if value]
    text = [
        '"""Weights of the facts on the possible causes; written by `benchmarks/probabilities.py --learn --renew`."""',
        "",
        "from __future__ import annotations",
        "",
        "from collections.abc import Mapping",
        "from types import MappingProxyType",
        "",
        "WEIGHTS: Mapping[str, float] = MappingProxyType(",
        "    {",
        *lines,
        "    }",
        ")",
        "",
    ]
    WEIGHTS_FILE.write_text("\n".join(text), encoding="utf-8")


def draw(rows: Sequence[Told]) -> None:
    """Write the picture of shares that are true over those told, with Wilson's intervals of 95 %."""
    import plotly.graph_objects as go

    from inspector.figures import to_svg

    p, true = np.array([r.p for r in rows]), np.array([r.is_true for r in rows], dtype=float)
    of = np.clip(np.digitize(p, BINS) - 1, 0, 9)
    told_share, shares, halves = [], [], []
    for k in np.unique(of):
        n, share, z = int(np.sum(of == k)), float(true[of == k].mean()), 1.96
        told_share.append(float(p[of == k].mean()))
        shares.append(share)
        halves.append(z * np.sqrt(share * (1 - share) / n + z * z / (4 * n * n)) / (1 + z * z / n))
    figure = go.Figure(
        [
            go.Scatter(x=[0, 1], y=[0, 1], mode="lines", name="as told", line={"dash": "dash", "color": "#808080"}),
            go.Scatter(x=told_share, y=shares, error_y={"array": halves}, mode="markers+lines", name="judged"),
        ]
    )
    heading = f"{len(rows)} causes told at 1 % or more, on arms from which nothing was learned"
    figure.update_layout(xaxis_title="probability told", yaxis_title="share that is true", title_text=heading)
    PICTURE.write_text(to_svg(figure, 620, 420), encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Learn and judge, as asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    parser.add_argument("--seed", type=int, default=JUDGE, help="of the judged arms")
    parser.add_argument("--learn", type=int, nargs="*", metavar="SEED")
    parser.add_argument("--renew", action="store_true")
    options = parser.parse_args(arguments)
    if options.keep is not None:
        options.keep.mkdir(parents=True, exist_ok=True)
    weights = None
    if options.learn is not None:
        weights = learned(all_judged(options.learn or LEARN, options.jobs, options.keep))
    rows = told(all_judged([options.seed], options.jobs, options.keep), weights)
    tell(rows)
    if options.renew:
        draw(rows)
        if weights is not None:
            write_weights(weights)


if __name__ == "__main__":
    main()
