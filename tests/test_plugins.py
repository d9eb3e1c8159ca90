"""Plug-ins are found by walking a package and by entry points; one that cannot be imported is left out and named."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from calib import plugins

PLUGIN = """from calib.plugins import PublicNames

CONTRIBUTIONS = (PublicNames("{module}", ("{name}",)),)
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty package `elsewhere` on the path, with caches that end with the test."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    plugins._walked.cache_clear()
    yield folder
    plugins._walked.cache_clear()
    for name in [name for name in sys.modules if name.partition(".")[0] == "elsewhere"]:
        del sys.modules[name]


def add(package: Path, name: str, content: str) -> None:
    (package / name).mkdir()
    (package / name / "__init__.py").write_text("")
    (package / name / "plugin.py").write_text(content)
    importlib.invalidate_caches()


def test_each_folder_of_a_package_brings_what_it_says(package: Path) -> None:
    add(package, "b", PLUGIN.format(module="math", name="tau"))
    add(package, "a", PLUGIN.format(module="math", name="pi"))
    (package / "no_folder.py").write_text("")
    brought = plugins.contributions(plugins.PublicNames, "elsewhere")
    assert [each.names for each in brought][:2] == [("pi",), ("tau",)]
    assert plugins.contributions(Path, "elsewhere") == ()
    assert plugins.left_out("elsewhere") == plugins.left_out("no_such_package") == ()


@pytest.mark.parametrize(
    "content",
    ["import no_such_module\n", "CONTRIBUTIONS = ", "", "raise OSError('first\\nsecond')\n"],
)
def test_one_that_cannot_be_imported_is_named_in_a_line_and_the_others_stay(package: Path, content: str) -> None:
    add(package, "broken", content)
    add(package, "whole", PLUGIN.format(module="math", name="pi"))
    assert [each.names for each in plugins.contributions(plugins.PublicNames, "elsewhere")][:1] == [("pi",)]
    (line,) = plugins.left_out("elsewhere")
    assert line.startswith("plug-in broken (elsewhere.broken.plugin) cannot be imported and is left out: ")
    assert "\n" not in line


def test_a_place_is_a_module_or_a_name_in_one() -> None:
    assert plugins.load("math:tau") > 6
    assert plugins.load("math") is importlib.import_module("math")
