"""The soak itself: what a case does wrong is found, a killed run goes on, its inputs mean what it says they mean."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
CSV = b"pose,role,q1_deg\np1,train,1.5\np2,test,-2.25\np3,train,3.0\n"


@pytest.fixture(scope="module")
def soaking() -> Iterator[None]:
    """benchmarks/ as a script there has it on its path."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    yield
    sys.path.remove(str(ROOT / "benchmarks"))


@pytest.fixture
def commands(soaking: None) -> ModuleType:
    from soaking.inputs import commands

    return commands


def _raises(*_: object) -> int:
    raise KeyError("x")


def _warns(*_: object) -> int:
    warnings.warn_explicit("odd", RuntimeWarning, "/somewhere/calib/fit.py", 3)
    return 0


def _says(words: str, code: int = 2) -> Callable[..., int]:
    def run(*_: object) -> int:
        sys.stderr.write(words + "\n")
        return code

    return run


@pytest.mark.parametrize(
    ("run", "trouble"),
    [
        (_raises, "traceback"),
        (_warns, "python warning"),
        (_says("inspector: one line"), ""),
        (_says("inspector: one\ninspector: two"), "lines"),
        (_says("inspector: " + "x" * 2000), "lines"),
        (_says("inspector: note: beside\ninspector: one line"), ""),
        (_says("", 3), "code"),
        (_says("inspector: internal error, KeyError"), "traceback"),
    ],
)
def test_a_broken_promise_is_found(
    commands: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    run: Callable[..., int],
    trouble: str,
) -> None:
    monkeypatch.setattr(commands, "main", run)
    assert commands.ran(tmp_path).trouble == trouble


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("code", "name", "trouble"), [(2, "out", "half-written"), (0, "out", ""), (0, "else", "half-written")]
)
def test_files_that_are_left_behind_are_found(
    commands: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, code: int, name: str, trouble: str
) -> None:
    def run(*_: object) -> int:
        (tmp_path / name).write_text("x")
        sys.stderr.write("inspector: one line\n")
        return code

    monkeypatch.setattr(commands, "main", run)
    assert commands.ran(tmp_path, outputs=(tmp_path / "out",)).trouble == trouble


@pytest.mark.thorough
def test_an_input_that_is_written_to_is_found(
    commands: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "in").write_text("x")
    monkeypatch.setattr(commands, "main", lambda *_: (tmp_path / "in").write_text("longer") and 0)
    assert commands.ran(tmp_path).trouble == "inputs"


def test_a_run_goes_on_after_a_line_that_was_cut(soaking: None, tmp_path: Path) -> None:
    from soaking.record import Record, Result

    record = Record(tmp_path / "files.jsonl")
    record.add(Result(0, "a"))
    record.add(Result(1, "a", trouble="hang"))
    with record.path.open("a") as file:
        file.write('{"number": 2, "ki')
    again = Record(record.path)
    assert again.left(range(4)) == [2, 3]
    assert again.left(range(4), retry=True) == [1, 2, 3]


CASES = """
import time, os
from soaking.record import Result
def attempt(number, seed, material, scratch):
    if number == 1: time.sleep(600)
    if number == 2: os._exit(7)
    if number == 3: raise ValueError("x")
    return Result(number, "good")
"""


@pytest.mark.thorough
def test_who_hangs_dies_or_raises_is_told_and_replaced(
    soaking: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soaking import pool

    (tmp_path / "soak_cases.py").write_text(CASES)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(pool, "IMPORT_S", 20.0)
    work = pool.Work("soak_cases", 0, tmp_path, 0.5)
    found = {r.number: r.trouble for r in pool.run(work, [0, 1, 2, 3, 4], tmp_path / "scratch", jobs=1)}
    assert found == {0: "", 1: "hang", 2: "died", 3: "traceback", 4: ""}
    assert not (tmp_path / "scratch").exists()


@pytest.mark.thorough
def test_what_is_said_to_mean_the_same_holds_the_same_cells(soaking: None) -> None:
    """By Python's own csv, not by the readers that are tried."""
    import csv

    from soaking.inputs import tables

    def cells(content: bytes) -> set[tuple[tuple[str, str], ...]]:
        rows = csv.DictReader(content.decode("utf-8-sig").splitlines(), skipinitialspace=True)
        return {
            tuple(sorted((k, v if k in ("pose", "role") else str(float(v))) for k, v in row.items())) for row in rows
        }

    rng = np.random.default_rng(0)
    for name, change in (tables.SAME | {"rows": tables.shuffled_rows}).items():
        assert cells(change(rng, CSV)) == cells(CSV), name
    spoiled = [change(np.random.default_rng(k), CSV) for change in tables.CHANGES.values() for k in range(30)]
    assert sum(content != CSV for content in spoiled) > 0.95 * len(spoiled)


@pytest.mark.thorough
def test_documents_that_mean_the_same_read_the_same(soaking: None) -> None:
    from soaking.inputs import documents

    rng = np.random.default_rng(1)
    toml = (ROOT / "sample_data" / "hidden_effect_b" / "dataset.toml").read_bytes()
    for name, change in documents.TOML_SAME.items():
        assert tomllib.loads(change(rng, toml).decode("utf-8-sig")) == tomllib.loads(toml.decode()), name
    tree: dict[str, Any] = {"a": [1.5, {"c": None, "b": "x"}], "z": {}}
    for name, change in documents.JSON_SAME.items():
        assert json.loads(change(rng, json.dumps(tree).encode())) == tree, name


@pytest.mark.thorough
def test_results_are_the_same_to_a_tolerance_and_no_further(soaking: None) -> None:
    from soaking.inputs.compared import difference

    a = {
        "rmse_mm": 0.1,
        "parameters": [{"name": "d1", "value": 1.0, "sigma": 0.1}],
        "verdict": "named",
        "seconds": 1.0,
    }
    parameter = a["parameters"][0]  # type: ignore[index]
    assert difference(a, a | {"seconds": 2.0, "rmse_mm": 0.1 + 1e-8}) == ""
    assert difference(a, a | {"parameters": [parameter | {"value": 1.00009}]}) == ""
    assert "[d1].value" in difference(a, a | {"parameters": [parameter | {"value": 1.0002}]})
    assert "verdict" in difference(a, a | {"verdict": "adequate"})
    assert "rmse_mm" in difference(a, a | {"rmse_mm": 0.1001})


@pytest.mark.thorough
def test_growing_memory_is_told_per_thousand_operations(soaking: None) -> None:
    from soaking.record import Result
    from soaking.tell import slope_mb, table

    pages = [Result(k, "page", mb=200.0 + 0.5 * k, figures={"server": 7.0}) for k in range(50)]  # 5 MB in 1,000
    assert slope_mb(pages) == pytest.approx(5.0)
    assert not table({"page": pages})[1]
    assert table({"page": [Result(k, "page", mb=200.0, figures={"server": 7.0}) for k in range(50)]})[1]


@pytest.mark.thorough
def test_a_small_soak_ends_well_and_its_second_call_runs_nothing(tmp_path: Path) -> None:
    command = [
        sys.executable,
        str(ROOT / "benchmarks" / "soak.py"),
        "--out",
        str(tmp_path),
        "--jobs",
        "1",
        "--scale",
        "0.002",
    ]
    command += ["--only", "files", "--only", "arms", "--only", "invariances"]
    first = subprocess.run(command, capture_output=True, text=True, timeout=170)
    assert first.returncode == 0, first.stdout + first.stderr
    lines = {path.name: path.read_text() for path in tmp_path.glob("*.jsonl")}
    assert {name: len(text.splitlines()) for name, text in lines.items()} == {
        "files.jsonl": 20, "arms.jsonl": 2, "invariances.jsonl": 2,
    }  # fmt: skip
    assert subprocess.run(command, capture_output=True, timeout=60).returncode == 0
    assert {path.name: path.read_text() for path in tmp_path.glob("*.jsonl")} == lines


@pytest.mark.slow
@pytest.mark.thorough
def test_odd_cells_keep_every_promise(soaking: None, tmp_path: Path) -> None:
    from soaking.inputs import odd_cells

    for number in range(60):
        scratch = tmp_path / str(number)
        scratch.mkdir()
        result = odd_cells.attempt(number, np.random.default_rng([5, number]), scratch)
        assert not result.trouble, (number, result.what, result.said)
