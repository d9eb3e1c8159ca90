"""`plan --program`, on a terminal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from inspector.cli.parser import main


def test_a_program_is_written_beside_the_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["plan", "rb5", "--poses", "3", "--json", "--program"]
    assert main([*asked, str(tmp_path / "measure.script")]) == 0
    document = json.loads(capsys.readouterr().out)
    text = (tmp_path / "measure.script").read_text()
    assert [f'measure_here("{pose["pose"]}")' in text for pose in document["poses"]] == [True] * 3
    assert main([*asked, str(tmp_path / "a.mod"), "--out", str(tmp_path / "poses.script")]) == 2
    assert "by --program" in capsys.readouterr().err
