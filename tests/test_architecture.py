"""Imports go down only and never in a circle, and `import calib` is quick."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Callable
from graphlib import CycleError, TopologicalSorter
from typing import Any

import pytest

import calib
from tests.support import ROOT

grimp = pytest.importorskip("grimp")
importlinter = pytest.importorskip("importlinter.cli")


@pytest.fixture(scope="module")
def graph() -> Any:
    """Every import of both packages, those inside functions and for type checkers too."""
    return grimp.build_graph("calib", "inspector", cache_dir=None)


def circle(graph: Any, box: Callable[[str], str]) -> list[str]:
    """One circle of imports between groups of modules; empty where there is none."""
    below: dict[str, set[str]] = {box(module): set() for module in graph.modules}
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            if box(imported) != box(module):
                below[box(module)].add(box(imported))
    try:
        TopologicalSorter(below).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def folder_of(module: str) -> str:
    """Folder of a module; a module at the top of a package is a room of its own, as in the contracts."""
    if module.count(".") == 1:
        return module
    is_folder = (ROOT / module.replace(".", "/")).is_dir()
    return module if is_folder else module.rpartition(".")[0]


def test_all_contracts_of_pyproject_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    kept = importlinter.lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True) == 0
    assert kept, capsys.readouterr().out


def test_no_circle_of_files(graph: Any) -> None:
    assert circle(graph, lambda module: module) == []


def test_no_circle_of_folders(graph: Any) -> None:
    assert circle(graph, folder_of) == []


def extra_of(module: str) -> str:
    """Name of the extra that a module is part of; "" for the core."""
    package, _, rest = module.partition(".extras.")
    return rest.partition(".")[0] if package in ("calib", "inspector") else ""


def test_no_module_of_the_core_and_no_other_extra_imports_an_extra(graph: Any) -> None:
    inwards = [
        f"{module} -> {imported}"
        for module in graph.modules
        for imported in graph.find_modules_directly_imported_by(module)
        if extra_of(imported) and extra_of(imported) != extra_of(module)
    ]
    assert inwards == []


def test_a_circle_would_be_found() -> None:
    graph = grimp.ImportGraph()
    for module in ("a", "a.x", "b", "b.y"):
        graph.add_module(module)
    graph.add_import(importer="a.x", imported="b.y")
    assert circle(graph, lambda module: module) == []
    graph.add_import(importer="b.y", imported="a.x")
    assert circle(graph, lambda module: module)
    assert circle(graph, lambda module: module.partition(".")[0])


@pytest.mark.slow
def test_the_public_face_offers_what_it_lists_and_changes_nothing_around_it() -> None:
    program = """
import json, os, sys
before = dict(os.environ)
import calib
quick = sorted({"numpy", "scipy", "pandas", "open3d"} & set(sys.modules))
offered = {name: getattr(calib, name).__module__ for name in calib._HOME}
assert set(calib.__all__) <= set(dir(calib)) and set(calib.__all__) == {"__version__", *calib._HOME}
assert calib.__version__
print(json.dumps([quick, offered, dict(os.environ) == before]))
"""
    said = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    quick, offered, same = json.loads(said.stdout)
    assert quick == []
    assert same, "importing sets environment variables"
    assert all(module.startswith("calib.") for module in offered.values())
    with pytest.raises(AttributeError, match="no attribute 'calibrat'"):
        calib.calibrat  # noqa: B018


def test_type_checkers_see_the_public_face_that_is_there() -> None:
    stub = ast.parse((ROOT / "calib" / "__init__.pyi").read_text("utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    assert {alias.name: node.module for node in imports for alias in node.names} == calib._HOME
    assert all(alias.asname == alias.name for node in imports for alias in node.names), "else not exported"
    assert ast.unparse(stub.body[-1]) == "__version__: str"
