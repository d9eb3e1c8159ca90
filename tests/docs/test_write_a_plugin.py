"""The package of the page "Write a plug-in" stands outside the tree, is found, and does what the page says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.code_blocks import Block, blocks_of, difference

PAGE = ROOT / "docs" / "tutorials" / "write_a_plugin.md"


def asked_for() -> set[str]:
    """Names of the kinds that core asks for."""
    files = (path for package in ("calib", "inspector") for path in (ROOT / package).rglob("*.py"))
    return {name for path in files for name in re.findall(r"\bcontributions\(([A-Z]\w+)", path.read_text("utf-8"))}


def test_the_page_lists_every_kind_that_is_asked_for() -> None:
    listed = re.findall(r"^\| `([\w.]+)\.(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert {name for _, name in listed} >= asked_for() > {"RobotForm", "Tab"}
    assert [f"{module}.{name}" for module, name in listed if not hasattr(import_module(module), name)] == []


def installed(site: Path, folder: Path) -> None:
    """Put a package where Python finds it, with its entry points, as pip does."""
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    info = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    points = (
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in named.items())
        for group, named in project["entry-points"].items()
    )
    (info / "entry_points.txt").write_text("\n".join(points))
    (site / "lab_arms").symlink_to(folder / "lab_arms")


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a reader who has written the page's files; the package is installed in `site`."""
    folder = tmp_path_factory.mktemp("reader")
    for block in blocks_of(PAGE):
        if block.file:
            (folder / block.file).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.file).write_text(block.text)
    installed(folder / "site", folder / "lab_arms")
    return folder


def inspector(reader: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{reader / 'site'}"}
    return subprocess.run(
        [sys.executable, "-P", "-m", "inspector", *words], cwd=reader, env=environment, capture_output=True, text=True
    )


def commands_with_output() -> list[tuple[Block, Block]]:
    blocks = blocks_of(PAGE)
    pairs = pairwise(blocks)
    return [
        (one, next_) for one, next_ in pairs if one.language == "sh" and next_.language == "text" and not next_.file
    ]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(2))
def test_the_commands_of_the_page_print_what_it_says(number: int, reader: Path) -> None:
    command, printed = commands_with_output()[number]
    done = inspector(reader, *command.text.split()[1:])
    assert (done.returncode, done.stderr) == (0, "")
    assert difference(printed.text, done.stdout) == ""


@pytest.mark.slow
def test_it_is_a_peer_of_what_is_built_in(reader: Path) -> None:
    assert "how far an arm's tool point gets from its base" in " ".join(inspector(reader, "--help").stdout.split())
    assert inspector(reader, "reach", "small.arm", "--poses", "10", "--json").stdout.startswith('{"robot": "small"')
    (reader / "bad.arm").write_text("turn 0 90\n")
    refused = inspector(reader, "reach", "bad.arm")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert refused.stderr.startswith("inspector: bad.arm: line 1: found 'turn 0 90', expected a name and five numbers")


@pytest.mark.slow
def test_one_that_cannot_be_imported_is_named_as_the_page_says(reader: Path) -> None:
    plugin = reader / "lab_arms" / "lab_arms" / "plugin.py"
    content = plugin.read_text()
    plugin.write_text("import no_such_package\n" + content)
    try:
        done = inspector(reader, "effects", "--json")
    finally:
        plugin.write_text(content)
    said = next(block for block in blocks_of(PAGE) if block.text.startswith("inspector: warning"))
    assert done.returncode == 0
    assert difference(said.text, done.stderr) == ""
