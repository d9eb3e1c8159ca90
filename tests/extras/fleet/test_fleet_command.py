"""`inspector fleet`: table, page, JSON and exit codes; refusals before the work starts."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pytest

from calib.extras.fleet.workers import Workers
from inspector.cli.parser import main
from inspector.extras.fleet import fleet_command
from tests.support.fleet import write_cell

HOSTILE = "<b>lot</b> & 17"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two datasets and a broken one; the work is done in this process."""

    @contextmanager
    def here(count: int, limit_s: float) -> Iterator[Workers]:
        yield Workers()

    monkeypatch.setattr(fleet_command, "local_workers", here)
    for seed, name in enumerate(("a", "sub dir/b")):
        write_cell(tmp_path / "fleet" / name, seed, serial=f"S{seed}", site="Ulm", gear=HOSTILE)
    (write_cell(tmp_path / "fleet" / "broken", 5) / "robot.toml").unlink()
    return tmp_path / "fleet"


def test_table_page_and_json(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out" / "cells.csv"
    assert main(["fleet", str(folder), "--out", str(out), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert [row["path"] for row in document["rows"]] == ["a", "sub dir/b"]
    assert [failed["path"] for failed in document["failed"]] == ["broken"]
    table = pd.read_csv(out)
    assert table["path"].tolist() == ["a", "sub dir/b"]
    assert table["about.gear"].tolist() == [HOSTILE, HOSTILE]
    assert not any("seconds" in name for name in table.columns)
    page = (tmp_path / "out" / "cells.html").read_text()
    assert document["page"].endswith("cells.html")
    assert HOSTILE not in page
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!\.\./fleet/)', page)  # nothing from outside, links to the datasets alone
    assert 'href="../fleet/sub%20dir/b/"' in page
    assert "robot.toml" in page  # why `broken` has no result
    pytest.importorskip("pyarrow")
    parquet = out.with_suffix(".parquet")
    assert main(["fleet", str(folder), "--out", str(parquet)]) == 1  # from the same results
    assert re.search(r"Taken from an earlier run +2\n", capsys.readouterr().out)
    pd.testing.assert_frame_equal(pd.read_parquet(parquet)[["path", "robot"]], table[["path", "robot"]])


def test_refusals_are_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "mine.csv"
    mine.write_text("a,b\n1,2\n")
    page = tmp_path / "other.html"
    page.write_text("<p>mine</p>")
    cases = (
        ([folder, "--out", mine], "is no table of a fleet"),
        ([folder, "--out", tmp_path / "other.csv"], "is no page of ours"),
        ([folder, "--out", tmp_path / "x.xlsx"], ".csv or .parquet"),
        ([tmp_path / "nowhere"], "no such folder"),
        ([folder, "--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "has its own"),
        ([folder, "--timeout", "0"], "seconds above 0"),
    )
    monkeypatch.chdir(tmp_path)
    for arguments, says in cases:
        try:
            code = main(["fleet", *map(str, arguments)])
        except SystemExit as stopped:
            code = int(str(stopped.code))
        captured = capsys.readouterr()
        assert code == 2, arguments
        assert says in captured.err
        assert captured.err.count("\n") == 1
        assert captured.out == ""
    assert mine.read_text() == "a,b\n1,2\n"
    assert not list(tmp_path.glob("*.results"))


def test_without_dask_one_line_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_cell(tmp_path / "a", 1)
    monkeypatch.setitem(sys.modules, "distributed", None)
    asked = ["fleet", str(tmp_path), "--out", str(tmp_path / "fleet.csv"), "--scheduler", "tcp://127.0.0.1:9"]
    assert main(asked) == 2
    assert "robot-calibration-inspector[fleet]" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert main(["fleet", str(tmp_path), "--out", str(tmp_path / "fleet.parquet")]) == 2
    assert "name a .csv" in capsys.readouterr().err


def test_a_run_that_is_stopped_says_how_to_go_on(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(fleet_command, "run_fleet", stopped)
    out = tmp_path / "fleet.csv"
    assert main(["fleet", str(folder), "--out", str(out)]) == 130
    assert "goes on" in capsys.readouterr().err
    assert not out.exists()
