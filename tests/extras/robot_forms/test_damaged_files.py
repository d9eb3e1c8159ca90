"""Damaged and hostile files of this extra's forms give a one-line error that names the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError
from calib.robot_formats.robot_file import ReadOptions, read_robot
from inspector.cli.parser import main
from tests.support.robot_texts import MJCF, UR10_CONF
from tests.support.scan_mutations import mutated
from tests.support.sweeps import sweep

FILES = {
    "arm.conf": (UR10_CONF, ReadOptions(model="ur10")),
    "arm.xml": (MJCF, ReadOptions(tip="tcp")),
}


@pytest.mark.parametrize("count", sweep([12, 400], every_run=[12]))
@pytest.mark.parametrize("name", FILES)
def test_a_damaged_robot_is_read_or_told_in_one_line(tmp_path: Path, name: str, count: int) -> None:
    text, reading = FILES[name]
    path, rng = tmp_path / name, np.random.default_rng(1)
    for _ in range(min(count, 60) if name == "arm.xml" else count):  # a process each
        path.write_bytes(mutated(text.encode(), rng))
        said = ""
        try:
            read_robot(path, reading)
        except CalibError as error:
            said = str(error)
        assert not said or said.startswith(str(path)), said
        assert "\n" not in said


def test_a_name_with_hidden_characters_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.replace('"j1"', '"j&#x202e;1"'), encoding="utf-8")
    assert main(["convert", str(path), str(tmp_path / "out.toml")]) == 2
    said = capsys.readouterr().err
    assert "hidden characters" in said
    assert "\u202e" not in said
    assert not (tmp_path / "out.toml").exists()
