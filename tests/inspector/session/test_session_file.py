"""Sessions as files: the same numbers come back, changes are told, and no file leads anywhere or crashes anything."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.dataset.files.fingerprint import fingerprint
from calib.errors import CalibError
from inspector.session import measuring
from inspector.session import transitions as sessions
from inspector.session.reopening import dataset_of, opening, reopened
from inspector.session.session import Session
from inspector.session.session_file import Shown, load_session, session_text
from tests.support.app import save_session
from tests.support.commands import refused
from tests.support.hidden_dataset import HIDDEN, write_hidden


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_hidden(tmp_path_factory.mktemp("data"), "cell")


@pytest.fixture(scope="module")
def worked_on(folder: Path) -> Session:
    """Added, removed, fitted to pairs: everything that a history can hold."""
    session = sessions.with_screening(sessions.with_calibration(measuring.open_session(folder)))
    session = sessions.with_screening(sessions.with_effect(session, HIDDEN))
    other = next((c.name for c in session.screening.candidates if c.members), None)
    if other is not None:
        session = sessions.with_effect(session, other)
        session = sessions.without_effect(session, other)
    return sessions.with_calibration(session, "pairs")


@pytest.fixture
def saved(worked_on: Session, tmp_path: Path) -> Path:
    path = tmp_path / "below" / "session.json"
    save_session(path, worked_on, Shown(pose="p0007", view="All corners", dark=True, arrows=300.0, factor=1000.0))
    return path


def opened(path: Path, root: Path) -> tuple[Session, tuple[str, ...]]:
    read = load_session(path)
    return reopened(measuring.open_session(dataset_of(read, root)), read)


def selections(session: Session) -> list[tuple[object, ...]]:
    """What was fitted in each step: effects, residual, poses without which."""
    return [(step.selected, step.calibration.residual, step.left_out) for step in session.steps]


@pytest.mark.slow
def test_everything_comes_back_to_the_last_bit(worked_on: Session, saved: Path, folder: Path) -> None:
    again, notes = opened(saved, folder)
    assert notes == ()
    assert np.array_equal(again.calibration.fit.x, worked_on.calibration.fit.x)
    assert again.calibration.residual == "pairs"
    assert again.effects == worked_on.effects
    assert str(again.history) == str(worked_on.history)  # nan is not equal to itself
    assert selections(again) == selections(worked_on)
    assert load_session(saved).shown == Shown("p0007", "All corners", True, 300.0, 1000.0)


def test_a_session_that_version_0_1_0_saved_opens_and_is_written_as_it_was() -> None:
    old, root = Path(__file__).with_name("saved_by_0_1_0.json"), Path(__file__).parents[3] / "sample_data"
    read = load_session(old)
    assert read.shown == Shown("p04", "All corners", True, 300.0, 1000.0)
    _, told = opening(read, root)
    again, notes = opened(old, root)
    assert (told, notes) == ((), ())  # dataset and figures are those of before
    assert [effect.name for effect in again.effects] == ["joint_compliance"]

    def rounded(text: str) -> str:  # figures to nine places: another processor rounds otherwise
        return re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda m: f"{float(m[0]):.9g}", text.partition('"history"')[2])

    document = json.loads(session_text(again, beside=old.parent, shown=read.shown))
    assert document.pop("program_version")
    assert document.pop("origin")["made"]  # which 0.1.0 did not write
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    assert text.partition('"history"')[0] == old.read_text("utf-8").partition('"history"')[0]
    renamed = rounded(text).replace('"as delivered"', '"nominal"').replace('"calibrated links"', '"link errors"')
    assert renamed == rounded(old.read_text("utf-8"))


def test_nothing_fitted_yet_is_a_session_too(folder: Path, tmp_path: Path) -> None:
    save_session(tmp_path / "s.json", measuring.open_session(folder))
    again, notes = opened(tmp_path / "s.json", folder)
    assert (again.calibration, notes) == (None, ())


@pytest.mark.slow
def test_the_folder_is_told_relative_and_found_when_both_move(worked_on: Session, folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "a"
    shutil.copytree(folder, place / "data" / "cell")
    moved = replace(worked_on, dataset=replace(worked_on.dataset, folder=place / "data" / "cell"))
    save_session(place / "sessions" / "s.json", moved)
    assert json.loads((place / "sessions/s.json").read_text())["dataset"]["folder"] == "../data/cell"
    place.rename(tmp_path / "b")
    read = load_session(tmp_path / "b" / "sessions" / "s.json")
    assert dataset_of(read, tmp_path / "b" / "data") == tmp_path / "b" / "data" / "cell"
    # Sent alone to someone who has the dataset elsewhere: the same dataset.toml tells.
    shutil.copytree(folder, tmp_path / "c" / "renamed")
    assert dataset_of(read, tmp_path / "c") == tmp_path / "c" / "renamed"


def test_a_changed_dataset_is_told_in_one_line_and_the_fit_is_of_what_is_there(
    saved: Path, folder: Path, tmp_path: Path
) -> None:
    there = tmp_path / "cell"
    shutil.copytree(folder, there)
    lines = (there / "points.csv").read_text().splitlines()
    lines[5] = lines[5].replace(".", ".1", 1)
    (there / "points.csv").write_text("\n".join(lines) + "\n")
    again, notes = opened(saved, there)
    assert notes[0] == "The dataset has changed since the session was saved: points.csv."
    assert any("saved was" in note for note in notes[1:])
    assert all("\n" not in note for note in notes)
    assert again.calibration is not None


def test_every_file_that_a_fit_reads_counts(folder: Path, tmp_path: Path) -> None:
    there = tmp_path / "cell"
    shutil.copytree(folder, there)
    whole = fingerprint(measuring.open_session(there).dataset)
    assert set(whole) == {"dataset.toml", "robot.toml", "poses.csv", "points.csv"}
    (there / "notes.txt").write_text("not read by a fit")
    assert fingerprint(measuring.open_session(there).dataset) == whole
    for name in whole:
        with (there / name).open("a") as file:
            file.write("\n")
        now = fingerprint(measuring.open_session(there).dataset)
        assert [n for n in now if now[n] != whole[n]] == [name]
        whole = now


# ---- bad files ------------------------------------------------------------------------------------------------------


def edited(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def member(document: dict[str, Any]) -> dict[str, float]:
    return document["history"][2]["effects"][0]["sizes"]


BAD: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "wrong version": (lambda d: d.update(version=2), "version: found 2; this program reads version 1"),
    "version true": (lambda d: d.update(version=True), "version: found True"),
    "no dataset": (lambda d: d.pop("dataset"), "dataset: found nothing"),
    "folder endless": (lambda d: d["dataset"].update(folder="../" * 5000), "dataset.folder"),
    "residual unknown": (
        lambda d: d["history"][1].update(residual="rust"),
        "history[1].residual: found 'rust'",
    ),
    "size a text": (lambda d: member(d).update(x="big"), "history[2].effects[0].sizes.x: found 'big'"),
    "size negative": (lambda d: member(d).update(x=-1.0), "sizes.x: found -1; a number above 0"),
    "size nan": (lambda d: member(d).update(x=float("nan")), "found NaN"),
    "unknown parameter": (lambda d: member(d).update({f"{HIDDEN}.J99.x": 1.0}), "J99.x"),
    "unknown effect": (lambda d: d["history"][2]["effects"][0].update(name="rust"), "no effect named 'rust'"),
    "noise without size": (lambda d: d["history"][1].update(noise={"scale": 0.0}), "history[1].noise: found"),
    "unknown pose out": (lambda d: d["history"][1].update(left_out=["p9999"]), "no pose named 'p9999'"),
    "too many steps": (lambda d: d.update(history=[{}] * 2000), "2000 entries"),
    "dark a number": (lambda d: d["shown"].update(dark=1), "shown.dark: found 1; true or false"),
    "parent folder": (lambda d: outside(d, ".."), "not at or below"),
    "system": (lambda d: outside(d, "../../../../../../etc"), "not at or below"),
}


def outside(document: dict[str, Any], folder: str) -> None:
    document["dataset"].update(folder=folder)
    document["dataset"]["files"].update({"dataset.toml": "0" * 64})


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_one_clear_line(saved: Path, folder: Path, name: str) -> None:
    change, says = BAD[name]
    edited(saved, change)
    with pytest.raises(CalibError) as caught:
        opened(saved, folder)
    line = str(caught.value)
    assert line.startswith(str(saved))
    assert says in line
    assert "\n" not in line
    assert len(line) < 700


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "not valid JSON"),
        (b'{"format": "robot', "line 1, column"),
        (b"[]", "found []; an object"),
        (b"\xff\xfe\x00", "cannot be read as text"),
        (b"[" * 100_000, "not a session file"),
        (b'{"version": ' + b"9" * 10_000 + b"}", "not a session file"),
        (b" " * 11_000_000, "larger than 10 MB"),
    ],
)
def test_what_is_no_session_file_is_one_clear_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "s.json"
    path.write_bytes(content)
    with pytest.raises(CalibError) as caught:
        load_session(path)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_a_link_out_of_the_served_folder_is_not_followed(saved: Path, folder: Path, tmp_path: Path) -> None:
    other = write_hidden(tmp_path / "elsewhere", "secret")
    served = tmp_path / "served"
    shutil.copytree(folder, served / "cell")
    edited(saved, lambda d: d["dataset"].update(folder=str(other)))
    assert dataset_of(load_session(saved), served) == served / "cell"  # by its dataset.toml, not by its path
    edited(saved, lambda d: outside(d, str(other)))
    with pytest.raises(CalibError, match="not at or below"):
        dataset_of(load_session(saved), served)


def test_serve_refuses_a_bad_session_with_exit_code_2(saved: Path, folder: Path) -> None:
    for change in (lambda d: d.update(version=9), lambda d: outside(d, "/etc")):
        edited(saved, change)
        captured = refused("serve", folder, "--port", "0", "--session", saved)
        assert str(saved) in captured
