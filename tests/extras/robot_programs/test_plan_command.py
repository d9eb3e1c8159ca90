"""`plan --program`, on a terminal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from inspector.cli.parser import main


def test_a_program_is_written_beside_the_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["plan", "rb5", "--poses", "3", "--json", "--program", str(tmp_path / "measure.script")]
    assert main([*asked, "--trigger", "output:1", "--settle-s", "0"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [way["pose"] for way in document["ways"]] == [pose["pose"] for pose in document["poses"]]
    assert "set_standard_digital_out(1, True)" in (tmp_path / "measure.script").read_text()
    assert main(["plan", "rb5", "--poses", "3", "--settle-s", "2"]) == 2
    assert "--settle-s is of a measuring program" in capsys.readouterr().err
