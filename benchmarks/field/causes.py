"""Which cause is named on arms of two simulators that share no code with the project; seeds are kept for the table."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import second_engine
import third_engine

from tests.support.engine.classes import cases as second_cases
from tests.support.third_engine.cases import cases as third_cases

SEED = 3001  # of the table alone; nothing is developed on it
PER_CLASS = {"second engine": 4, "third engine": 3}


def shares(engine: str, jobs: int) -> dict[str, object]:
    """Shares of an engine's sets: exact, left open with the truth in it, a wrong name claimed, calm and wrong."""
    if engine == "second engine":
        rows = second_engine.results(list(second_cases(PER_CLASS[engine], SEED, ())), jobs)
        rows = rows.rename(columns={"falsely_satisfied": "calm_wrong"})
    else:
        asked = list(third_cases(PER_CLASS[engine], SEED, ()))
        rows = second_engine.results(asked, jobs, third_engine.run, third_engine.judged)
    kept = ("exact", "left_open", "wrong_claim", "calm_wrong")
    found: dict[str, object] = {name: float(pd.Series(rows[name], dtype=float).mean()) for name in kept}
    return found | {"sets": len(rows), "seed": SEED, "seconds": float(rows["seconds"].median())}
