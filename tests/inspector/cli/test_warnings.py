"""What Python and NumPy warn of is no line on a user's terminal."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import inspector.__main__ as entry

PROGRAM = """
import sys, warnings
import numpy as np
import inspector.__main__ as entry

def main():
    np.array([1e308]) * np.array([1e308])
    warnings.warn("UserWarning of a package")
    print("inspector: refused", file=sys.stderr)
    return 2

entry.main = main
sys.exit(entry.command())
"""


@pytest.mark.parametrize(("options", "lines"), [([], 1), (["-W", "always"], 5)])
def test_an_error_is_the_one_line_unless_warnings_are_asked_for(options: list[str], lines: int) -> None:
    done = subprocess.run(
        [sys.executable, *options, "-c", PROGRAM], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 2
    assert "inspector: refused" in done.stderr
    assert (len(done.stderr.splitlines()) == 1) == (lines == 1)


def test_processes_that_it_starts_keep_still_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(entry, "main", lambda: 0)
    monkeypatch.setattr(sys, "warnoptions", [])
    monkeypatch.delenv("INSPECTOR_DEBUG", raising=False)
    monkeypatch.setenv("PYTHONWARNINGS", "")
    with warnings.catch_warnings():
        assert entry.command() == 0
    child = [sys.executable, "-c", "import warnings; warnings.warn('x'); 1 / 1"]
    assert subprocess.run(child, capture_output=True, check=False, timeout=60).stderr == b""


def test_the_command_that_is_installed_is_this_one() -> None:
    project = (Path(__file__).parents[3] / "pyproject.toml").read_text("utf-8")
    assert 'inspector = "inspector.__main__:command"' in project
