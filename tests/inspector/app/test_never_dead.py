"""The page goes on whatever a user's effect, a file that changes or a dataset beside it does."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support.app import idle, idle_app, shows
from tests.support.commands import refused
from tests.support.hidden_dataset import HIDDEN, write_hidden
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
        idle(app)
        assert app.state.session.calibration is not None


@pytest.mark.parametrize("ending", ENDINGS[:1] + ENDINGS[2:])
def test_the_command_says_so_too(tmp_path: Path, ending: str) -> None:
    folder = write_hidden(tmp_path)
    effects_file = tmp_path / "mine.py"
    effects_file.write_text(EFFECT.format(ending=ending), "utf-8")
    said = refused("diagnose", folder, "--effects-file", effects_file)
    assert "effect Mine: `apply`" in said


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
