"""The page goes on whatever a user's effect, a file that changes or a dataset beside it does."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calib.scans.scan import Scan, load_scan, write_scan
from inspector.app.app import App
from inspector.cli.parser import main
from tests.support.app import IDLE_S, idle_app, shows
from tests.support.hidden_dataset import HIDDEN, write_hidden
from tests.support.tiny_dataset import write_tiny
from tests.support.wire_client import WireClient

pytestmark = pytest.mark.slow

EFFECT = """
from calib import Parameter

calls = []


class Mine:
    parameters = (Parameter("k_rad", unit="rad", scale=1e-4),)

    def apply(self, state, *, k_rad):
        calls.append(k_rad)
        if len(calls) > 3:
            {ending}
        return state.add_joint_error(1, k_rad * state.q_rad[:, 0] ** 2)
"""
ENDINGS = (
    "import sys; sys.exit()",
    "raise KeyboardInterrupt",
    "raise GeneratorExit",
    "raise BaseException('no')",
)


@pytest.mark.thorough
@pytest.mark.parametrize("ending", ENDINGS)
def test_an_effect_that_ends_the_program_is_told_and_the_page_goes_on(tmp_path: Path, ending: str) -> None:
    folder = write_hidden(tmp_path)
    effects_file = tmp_path / "mine.py"
    effects_file.write_text(EFFECT.format(ending=ending), "utf-8")
    with idle_app(folder, effects_file) as app, WireClient(app.server.get_port()) as page:
        shows(page, "effect Mine: `apply`")
        page.trigger("Next pose")
        shows(page, "2 of 45")
        effects_file.unlink()
        app.effects()
        assert app.worker.wait_idle(IDLE_S)
        assert app.state.session.calibration is not None


@pytest.mark.parametrize("ending", ENDINGS[:1] + ENDINGS[2:])
def test_the_command_says_so_too(tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_hidden(tmp_path)
    effects_file = tmp_path / "mine.py"
    effects_file.write_text(EFFECT.format(ending=ending), "utf-8")
    assert main(["diagnose", str(folder), "--effects-file", str(effects_file), "--json"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "effect Mine: `apply`" in said.err


@pytest.fixture(scope="module")
def scanned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny(tmp_path_factory.mktemp("datasets"))


@pytest.fixture
def opened(scanned: Path, tmp_path: Path) -> Iterator[tuple[App, Path]]:
    folder = tmp_path / "cell"
    shutil.copytree(scanned / "cell", folder)
    with idle_app(folder) as app:
        yield app, folder


@pytest.mark.thorough
def test_a_scan_that_changes_under_the_page_is_told_and_not_drawn(opened: tuple[App, Path]) -> None:
    app, folder = opened
    first, second = sorted((folder / "scans").iterdir())[:2]
    scan = load_scan(second)
    write_scan(second, Scan(scan.name, scan.points_mm[:50]))
    first.unlink()
    with WireClient(app.server.get_port()) as page:
        for pose, says in (
            (2, "3 of"),
            (0, "no such file"),
            (1, "has changed since it was searched"),
            (0, "no such file"),
        ):
            app.select(pose)
            assert app.worker.wait_idle(IDLE_S)
            shows(page, says)
        assert not page.notifications


def test_a_dataset_that_cannot_be_read_stops_no_other(tmp_path: Path) -> None:
    good = write_hidden(tmp_path)
    for name, text in (
        ("a_digits", "[x]\ny = " + "9" * 400),
        ("b_digits", "[x]\ny = " + "9" * 5000),
        ("c_nested", "[x]\ny = " + "[" * 900 + "]" * 900),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "dataset.toml").write_text(text, "utf-8")
    shutil.copytree(good, tmp_path / "d_pipe")
    (tmp_path / "d_pipe" / "poses.csv").unlink()
    os.mkfifo(tmp_path / "d_pipe" / "poses.csv")
    with idle_app(tmp_path) as app, WireClient(app.server.get_port()) as page:
        for name in ("a_digits", "b_digits", "c_nested", "d_pipe"):
            app.open(name)
        app.open(good.name)
        shows(page, HIDDEN)
        assert app.state.name == good.name
        assert np.isfinite(app.state.session.history[-1].test_rmse_mm)
