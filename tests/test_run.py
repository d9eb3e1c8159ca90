"""The script `run`, driven with a stand-in for Python that records how it was called: no network, nothing installed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.support import ROOT

# All that `run` may need of a system. Not there: python3.12, apt-get, sudo and chromium of the machine that tests it.
TOOLS = re.findall(r"\w+", "sh cat chmod cksum cp dirname env grep id mkdir readlink rm sed tail touch")
FAKE_PYTHON = """#!/bin/sh
printf '%s\\n' "$*" >>"$CALLS"
case "$*" in
"-c import sys; sys.exit(not"*) exit "${FITS_EXIT:-0}" ;;
"--version") echo "Python 3.9.9" ;;
"-c import open3d") [ -z "${OPEN3D_ERROR:-}" ] || { echo "$OPEN3D_ERROR" >&2; exit 1; } ;;
"-c import ensurepip, venv") exit "${ENSUREPIP_EXIT:-0}" ;;
"-c import sys; print("*) echo 3.11 ;;
"-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
"-m pip install"*) echo "${PIP_SAYS:-}"; exit "${PIP_EXIT:-0}" ;;
"-m ruff check"*) exit "${RUFF_EXIT:-0}" ;;
"-m sphinx"*) exit "${SPHINX_EXIT:-0}" ;;
"-m mypy"*) exit "${MYPY_EXIT:-0}" ;;
"-m pytest --version") ;;
"-m pytest"*) exit "${PYTEST_EXIT:-0}" ;;
esac
"""
ALL_CORES = "-m pytest -n auto --dist loadfile --no-loadscope-reorder -m not thorough"


@dataclass
class Sandbox:
    """A copy of `run` in a folder whose name has a space, and a PATH that holds nothing but TOOLS and the stand-in."""

    folder: Path
    project: Path = field(init=False)
    tools: Path = field(init=False)

    def __post_init__(self) -> None:
        self.project, self.tools = self.folder / "a 'project", self.folder / "bin"
        self.project.mkdir()
        self.tools.mkdir()
        for name in ("run", "pyproject.toml"):
            shutil.copy(ROOT / name, self.project / name)
        for tool in TOOLS:
            path = shutil.which(tool)
            assert path, tool
            (self.tools / tool).symlink_to(path)
        self.program("python3", FAKE_PYTHON)

    def program(self, name: str, text: str) -> None:
        path = self.tools / name
        path.unlink(missing_ok=True)
        path.write_text(text)
        path.chmod(0o755)

    def run(
        self, *args: str, program: str = "run", **env: str
    ) -> tuple[subprocess.CompletedProcess[str], Sequence[str]]:
        """Call `run` from another folder; returns what it did and how it called Python, call by call."""
        calls = self.folder / "calls"
        calls.write_text("")
        known = {"PATH": str(self.tools), "CALLS": str(calls), "CHROMIUM": "sh"}
        command = [str(self.project / program), *args]
        done = subprocess.run(command, cwd=self.folder, env=known | env, capture_output=True, text=True, check=False)
        return done, calls.read_text().splitlines()


@pytest.fixture
def sandbox(tmp_path: Path) -> Sandbox:
    return Sandbox(tmp_path)


def inspector_call(calls: Sequence[str]) -> str:
    assert calls[-1].startswith("-P -m inspector "), calls
    return calls[-1].removeprefix("-P -m inspector ")


def test_is_plain_posix_sh():
    shell = shutil.which("dash") or "sh"
    done = subprocess.run([shell, "-n", str(ROOT / "run")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    text = (ROOT / "run").read_text()
    assert text.startswith("#!/bin/sh\n")
    assert os.access(ROOT / "run", os.X_OK)
    # dash takes these for ordinary words, so -n does not find them
    bashisms = r"\[\[|^\s*(?:function|local|source|declare)\s|<<<|&>|\$'|\$\{\w+(?://|\^|,)|\[ [^]]* == "
    assert re.findall(bashisms, text, flags=re.MULTILINE) == []


def test_first_call_installs_and_the_second_starts_at_once(sandbox: Sandbox):
    done, calls = sandbox.run("check", "some where/data", "--json")
    assert done.returncode == 0, done.stderr
    assert f"-m venv {sandbox.project}/.venv" in calls
    assert any(call.endswith("--editable .[scans,page]") for call in calls)
    assert inspector_call(calls) == "check some where/data --json"
    assert done.stdout == "", "stdout belongs to the command"

    done, calls = sandbox.run("check", "x")
    assert calls == ["-P -m inspector check x"]
    assert done.stderr == ""


@pytest.mark.slow
def test_tests_run_in_order_and_stop_at_the_first_failure(sandbox: Sandbox):
    done, calls = sandbox.run("test")
    checks = [call for call in calls if re.match(r"-m (ruff|mypy|pytest)", call)]
    assert checks[:3] == ["-m ruff check .", "-m ruff format --check .", "-m mypy"]
    core, whole = checks[3:]  # in a copy without extras, and what that leaves out
    assert core.startswith(f"{ALL_CORES} --ignore=")
    assert whole.startswith(f"{ALL_CORES} tests/extras ")
    assert whole.removeprefix(f"{ALL_CORES} ").split() == re.findall(r"--ignore=(\S+)", core)
    copied = calls.index("-m tests.support.copies build/core")
    assert calls.index("-m mypy") < copied < calls.index(core)
    assert done.returncode == 0

    done, calls = sandbox.run("test", MYPY_EXIT="2")
    assert done.returncode == 2
    assert calls[-1] == "-m mypy"

    done, calls = sandbox.run("test", PYTEST_EXIT="3")
    assert done.returncode == 3

    done, calls = sandbox.run("test", "-k", "two words", RUFF_EXIT="1")
    assert calls == ["-m pytest -n auto --dist loadfile --no-loadscope-reorder -k two words"]
    assert done.returncode == 0


@pytest.mark.parametrize("fails", ["PYTEST_EXIT", "SPHINX_EXIT", "MYPY_EXIT", ""])
def test_ci_builds_pages_beside_types_and_artefacts_then_runs_the_tests(sandbox: Sandbox, fails: str):
    (sandbox.project / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", sandbox.project / ".ci" / "run")
    (sandbox.tools / "bash").symlink_to(shutil.which("bash") or "")
    artefacts = sandbox.project / ".ci" / "artefacts"
    artefacts.write_text('#!/bin/sh\necho artefacts >>"$CALLS"\n')
    artefacts.chmod(0o755)
    done, calls = sandbox.run(**{fails: "5"} if fails else {}, program=".ci/run")
    assert (done.returncode != 0) is bool(fails), done.stderr
    installed = [call for call in calls if " pip install " in call]
    assert [call.partition(" install")[0] for call in installed] == ["-m pip", "-m uv pip"]
    assert ("artefacts" in calls) is (fails != "MYPY_EXIT")
    assert any(call.startswith("-m sphinx ") for call in calls)
    last = "-m mypy" if fails == "MYPY_EXIT" else f"{ALL_CORES} tests/extras "
    assert calls[-1].startswith(last)
