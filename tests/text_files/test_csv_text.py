"""Untrusted CSV tables and CSV for spreadsheets: bounds, digits, formulas, hidden characters in names."""

from __future__ import annotations

import csv
import os
import threading
import tracemalloc
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.dataset.files.csv_table import TableFile
from calib.dataset.files.folder import load_dataset
from calib.effects.catalogue.user_file import load_effects
from calib.errors import MOST_CHARACTERS, CalibError, DatasetError, is_one_line, printable
from calib.fitting.observations import nominal_state
from calib.text_files.csv_text import as_number, csv_rows, frame_csv, rows_csv
from calib.text_files.user_table import Fault, load_table
from inspector.app.page.dataset_list import names_of
from tests.support.hidden_dataset import write_hidden

EFFECT = """
from calib import Parameter


class Mine:
    name = "mine\\u202e"
    parameters = (Parameter("k_rad", unit="rad", scale=1e-4),)

    def apply(self, state, *, k_rad):
        return state.add_joint_error(1, k_rad * state.q_rad[:, 0] ** 2)
"""
FORMULAS = ('=HYPERLINK("http://x")', "@SUM(A1)", "+1+2", "-1-2", "=1", "＝1+1", "'=1", "''=1", "-x", "+")


def said_of(path: Path, content: str) -> str:
    path.write_text(content, "utf-8")
    file = TableFile.load(path)
    with pytest.raises(DatasetError) as caught:
        file.numbers(["a"]) if "a" in file else file.require(["a"])
    return str(caught.value)


@pytest.mark.parametrize("sparse", [",\n" * 6_000_000, "," * 12_000_000 + "\n"])
def test_cells_are_counted_before_any_is_made(tmp_path: Path, sparse: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text("pose,a\n" + sparse, "utf-8")
    for load in (TableFile.load, load_table):
        tracemalloc.start()
        with pytest.raises(DatasetError, match=r"12 million cells.* at most 10 million, so remove"):
            load(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 5 * path.stat().st_size


def test_a_pipe_gives_no_more_than_a_file_may_have(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.csv"
    os.mkfifo(path)
    threading.Thread(target=path.write_bytes, args=(b"1" * 2000,), daemon=True).start()
    monkeypatch.setattr("calib.dataset.files.csv_table.MOST_BYTES", 1000)
    with pytest.raises(DatasetError, match=r"a CSV file of a dataset has at most 0.001 MB"):
        TableFile.load(path, pipe=True)


@pytest.mark.parametrize("cell", ["1_0", "１２", "٣.5", "1e1_0", "−1"])
def test_what_python_alone_takes_for_a_number_is_none(tmp_path: Path, cell: str) -> None:
    assert f"line 3, column a: found {cell!r}; a number is needed" in said_of(
        tmp_path / "t.csv", f"pose,a\np1,1\np2,{cell}\n"
    )
    assert as_number(cell) is None
    (tmp_path / "u.csv").write_text(f"pose,a\np1,{cell}\n", "utf-8")
    faults: list[Fault] = []
    assert np.isnan(load_table(tmp_path / "u.csv").numbers("a", faults.append)).all()
    assert "line 2, column a" in str(faults[0])
    rest = TableFile.load(tmp_path / "u.csv").rest(["pose"])
    assert rest["a"].tolist() == [cell]  # a text, not a number that nobody wrote


def test_formulas_stand_as_texts_and_numbers_as_numbers() -> None:
    frame = pd.DataFrame({"=pose": FORMULAS, "x_mm": np.linspace(-1, 1, len(FORMULAS)), "n": "-5"})
    header, *rows = csv.reader(StringIO(frame_csv(frame)))
    assert header == ["'=pose", "x_mm", "n"]
    assert [row[0] for row in rows] == [f"'{text}" for text in FORMULAS]
    assert [float(row[1]) for row in rows] == frame["x_mm"].tolist()
    assert {row[2] for row in rows} == {"-5"}


@settings(max_examples=40)
@given(st.lists(st.tuples(st.text("=+-@'a1. ,\"").map(str.strip), st.floats(-9, 9)), min_size=1))
def test_what_is_written_is_read_again(cells: list[tuple[str, float]]) -> None:
    rows = [[text, repr(number)] for text, number in cells]
    assert [row for _, row in csv_rows(Path("t.csv"), rows_csv(rows))] == rows
    frame = pd.DataFrame({"text": [t for t, _ in cells], "number": [n for _, n in cells]})
    _, *read = csv_rows(Path("t.csv"), frame_csv(frame))
    assert [row for _, row in read] == rows


@pytest.mark.parametrize("hidden", ["\u202e", "\u2066", "\u200f", "\u200b", "\x1b", "\ufeff", "\x9b", "\n"])
def test_what_turns_or_hides_text_is_in_no_name(hidden: str) -> None:
    assert not is_one_line(f"p{hidden}1")
    said = str(CalibError(f"cell{hidden}/poses.csv: no"))
    assert is_one_line(said) or hidden == "\n"


def test_names_from_strangers_hide_nothing(tmp_path: Path) -> None:
    folder = write_hidden(tmp_path)
    for file, old, new, place in (
        ("poses.csv", "pose,", "pose,a\u202eb,", "line 1: found a column 'a\\u202eb'"),
        ("robot.toml", 'name = "J2"', 'name = "J\u202e2"', "name: found 'J\\u202e2'"),
        ("dataset.toml", 'name = "', 'name = "\u2066', "name: found '\\u2066"),
    ):
        path = folder / file
        text = path.read_text("utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), "utf-8")
        with pytest.raises(DatasetError) as caught:
            load_dataset(folder)
        assert place in str(caught.value)
        path.write_text(text, "utf-8")
    (turned,) = names_of([tmp_path / "cell\u202etxt"])
    assert turned == "cell\\u202etxt"
    effects = tmp_path / "mine.py"
    effects.write_text(EFFECT, "utf-8")
    with pytest.raises(CalibError, match=r"its name is no line without control"):
        load_effects(effects, nominal_state(load_dataset(folder)))


def test_names_of_all_scripts_are_names() -> None:
    for name in ("Zelle 3", "左腕", "می‌خواهم", "क्‍ष", "p\u00a01", "α-β_γ"):
        assert is_one_line(name)
        assert printable(name) == name


def test_a_long_line_keeps_what_stands_at_its_ends() -> None:
    said = str(CalibError(f"cell/poses.csv: line 3: found {'x' * 9000}; write a number"))
    assert len(said) <= MOST_CHARACTERS
    assert said.startswith("cell/poses.csv: line 3: found xxx")
    assert said.endswith("xxx; write a number")
    faults = "\n".join(f"line {i}: {'y' * 30}" for i in range(90))
    assert str(CalibError(faults)) == faults  # a list of short lines stays


def test_a_table_of_hundreds_of_columns_is_not_told_whole(tmp_path: Path) -> None:
    said = said_of(tmp_path / "t.csv", ",".join(f"c{i}" for i in range(900)) + "\n" + "1," * 899 + "1\n")
    assert "missing column a; found c0, c1" in said
    assert "and 870 more" in said
    assert len(said) < 600


@pytest.mark.slow
def test_a_million_columns_are_refused_and_a_spreadsheet_s_empty_ones_are_not(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    for text in (
        ",".join(f"c{k}" for k in range(1_000_000)),
        "a\n" + ",".join("1" * 3000),
        "a" + "," * 30_000,
    ):
        with pytest.raises(DatasetError, match=r"line \d: found \d+ columns; a table has at most 2000"):
            csv_rows(path, text)
    wide = "pose,a" + "," * 16_382 + "\n" + "p1,2" + "," * 16_382 + "\n"
    assert [row[1][:2] for row in csv_rows(path, wide)] == [["pose", "a"], ["p1", "2"]]
