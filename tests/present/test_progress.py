"""How far long work has come: asked for or not, in a notebook's cell, at a terminal, into a file."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import calib
from calib import cross_validate, learning_curve, progress

SAMPLES = Path(__file__).parents[2] / "sample_data"


class Cell:
    """What a notebook's front end would show of one display: all that was shown in its place, in order."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def display(self, html: str, *, display_id: bool) -> Cell:
        assert display_id
        self.shown.append(html)
        return self

    def update(self, html: str) -> None:
        self.shown.append(html)


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Cell:
    """A notebook: a shell with a kernel, and the two functions of IPython that are used."""
    cell = Cell()
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))  # type: ignore[arg-type]
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=cell.display, HTML=str))  # type: ignore[arg-type]
    monkeypatch.setattr(progress, "_EVERY_S", 0.0)
    return cell


@pytest.mark.slow
def test_nobody_who_did_not_ask_sees_anything(cell: Cell, capsys: pytest.CaptureFixture[str]) -> None:
    dataset = calib.load_dataset(SAMPLES / "hidden_effect_a")
    calib.diagnose(dataset, max_steps=0)
    cross_validate(dataset, folds=2)
    assert cell.shown == []
    assert capsys.readouterr() == ("", "")


def test_a_cell_shows_each_part_and_keeps_nothing(cell: Cell, capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[tuple[int, int, str]] = []
    dataset = calib.load_dataset(SAMPLES / "hidden_effect_a")
    cross_validate(dataset, folds=3, progress=True, on_progress=lambda *said: seen.append(said))
    assert [f'value="{done}" max="3"' in html for done, html in zip((1, 2, 3), cell.shown[1:], strict=False)] == [
        True
    ] * 3
    assert "fits: 2 of 3, fold 2" in cell.shown[2]
    assert (cell.shown[0], cell.shown[-1]) == ("", "")
    assert seen == [(1, 3, "fold 1"), (2, 3, "fold 2"), (3, 3, "fold 3")]
    learning_curve(dataset, counts=[20, 30], repeats=1, progress=True)
    assert "fits: 2 of 2, 30 poses" in cell.shown[-2]
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_a_cell_names_the_stage_of_a_diagnosis(cell: Cell) -> None:
    calib.diagnose(calib.load_dataset(SAMPLES / "hidden_effect_a"), progress=True)
    assert "fitting the geometry ..." in cell.shown[1]
    assert any("judging what is left ..." in html for html in cell.shown)
    assert cell.shown[-1] == ""


def test_names_beside_a_bar_are_escaped_and_cut(cell: Cell) -> None:
    with progress.counted("<i>", "scan") as tell:
        assert tell is not None
        tell(1, 2, "<script>" + 200 * "x")
    assert "<script>" not in cell.shown[1]
    assert "&lt;i&gt;: 1 of 2, &lt;script&gt;xx" in cell.shown[1]
    assert len(cell.shown[1]) < 300


def test_scans_and_corners_have_bars(cell: Cell, tmp_path: Path) -> None:
    few = calib.load_dataset(SAMPLES / "rb5_repeats")
    two = few.leave_out(few.poses.ids[2:])
    found = calib.find_corners(two, progress=True, intermediate=False)
    assert f"corners: 2 of 2, {list(found)[-1]}" in cell.shown[-2]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.slow
def test_a_terminal_has_one_line_and_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    dataset = calib.load_dataset(SAMPLES / "hidden_effect_a")
    calib.diagnose(dataset, max_steps=0, progress=True)
    said = terminal.getvalue()
    assert "fitting the geometry ..." in said
    assert "\n" not in said
    assert said.endswith("\r\033[K")
    cross_validate(dataset, folds=2, progress=True)
    bars = terminal.getvalue()[len(said) :]
    assert "fits" in bars
    assert bars.endswith("\r")
    assert "\n" not in bars


@pytest.mark.slow
def test_a_file_gets_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    dataset = calib.load_dataset(SAMPLES / "hidden_effect_a")
    cross_validate(dataset, folds=2, progress=True)
    calib.diagnose(dataset, max_steps=0, progress=True)
    assert capsys.readouterr() == ("", "")
