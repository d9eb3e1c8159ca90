"""Input that no one meant to give: each is one line that names its place, exit code 2, and nothing is half-written."""

from __future__ import annotations

from pathlib import Path

import pytest

from inspector.cli import main


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line on stderr; exit code 2, nothing on stdout, and no talk of an internal error."""
    assert main([*map(str, arguments)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = [line for line in captured.err.splitlines() if "inspector: warning" not in line]
    assert len(lines) == 1, captured.err
    assert "internal error" not in lines[0]
    return lines[0]


@pytest.mark.parametrize("noise_mm", ["1e-9", "1e9", "-0.1", "nan", "inf"])
def test_simulate_writes_no_dataset_that_cannot_be_read(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, noise_mm: str
) -> None:
    line = refused(capsys, "simulate", tmp_path / "cell", "--robot", "rb5", "--noise-mm", noise_mm)
    assert (
        f"--noise-mm {noise_mm.replace('e-9', 'e-09').replace('e9', 'e+09')}: give 0, or 1e-06 to 1000 mm"
        in line
    )
    assert list(tmp_path.iterdir()) == []
