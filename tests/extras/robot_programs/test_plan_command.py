"""`plan --program`, on a terminal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from inspector.cli.parser import main


def test_a_program_and_its_template(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = tmp_path / "own.j2"
    asked = ["plan", "rb5", "--poses", "3", "--json", "--program", str(tmp_path / "measure.script")]
    assert main([*asked, "--template-out", str(own), "--trigger", "output:1", "--settle-s", "0"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [way["pose"] for way in document["ways"]] == [pose["pose"] for pose in document["poses"]]
    shipped = (tmp_path / "measure.script").read_text()
    assert "set_standard_digital_out(1, True)" in shipped
    own.write_text("# the workshop's own\n" + own.read_text())
    assert main([*asked, "--template", str(own), "--trigger", "output:1", "--settle-s", "0"]) == 0
    assert (tmp_path / "measure.script").read_text() == "# the workshop's own\n" + shipped
    capsys.readouterr()
    own.write_text(own.read_text().replace("{{ program }}", "{{ programm }}"))
    assert main([*asked, "--template", str(own)]) == 2
    assert "no placeholder 'programm'; did you mean program?" in capsys.readouterr().err
    assert main(["plan", "rb5", "--poses", "3", "--settle-s", "2"]) == 2
    assert "--settle-s is of a measuring program" in capsys.readouterr().err
