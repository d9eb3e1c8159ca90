"""The house rules that a program can check: what imports what, what is in the repository, what README promises."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

from inspector.cli.commands import commands, declarations
from inspector.cli.options.declaration import arguments_of
from tests.support import ROOT
from tests.support.copies import extras, tracked_files

HEAVY = ("open3d", "trimesh", "viser", "plotly")
# An absolute path into somebody's machine: the lookbehind lets the path part of a URL pass.
MACHINE_PATH = re.compile(r"(?<![\w.~-])/(?:work|root|home|Users|tmp)/\w|[A-Z]:\\Users\\")


def python_files(package: str) -> list[Path]:
    files = [path for path in tracked_files() if path.is_relative_to(ROOT / package) and path.suffix == ".py"]
    assert files, f"no Python file in {package}"
    return files


@cache
def parsed(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def imported_names(path: Path) -> set[str]:
    """Top-level packages that a file imports anywhere, also inside functions."""
    names = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


def imported_at_once(path: Path) -> set[str]:
    """Top-level packages that a file imports when it is loaded."""
    body = parsed(path).body
    return {alias.name.split(".")[0] for node in body if isinstance(node, ast.Import) for alias in node.names} | {
        node.module.split(".")[0] for node in body if isinstance(node, ast.ImportFrom) and node.module
    }


# ---- imports --------------------------------------------------------------------------------------------------------


def test_a_diagnosis_of_measured_points_loads_no_library_that_it_can_do_without() -> None:
    # Each takes a quarter of a second or more to load, as long as the diagnosis itself.
    slow = (*HEAVY, "pandas", "scipy.stats", "jinja2")
    program = f"""
import json, sys
from inspector.cli.parser import main
words = ["diagnose", {str(ROOT / "sample_data" / "hidden_effect_a")!r}]
codes = main(words), main([*words, "--json"])
print(json.dumps([*codes, [name for name in {slow!r} if name in sys.modules]]))
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == [0, 0, []]


IMPORTED_AS = {
    "open3d-cpu": "open3d",
    "opencv-python-headless": "cv2",
    "pillow": "PIL",
    "pyyaml": "yaml",
}  # where a package's name is not its module's


def modules_of(requirements: list[str]) -> set[str]:
    """The modules that some of pyproject's lines bring."""
    packages = {re.match(r"[\w.-]+", line)[0] for line in requirements}
    return {IMPORTED_AS.get(package, package.replace("-", "_")) for package in packages}


WITHOUT_EXTRAS = """
import json, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {extras!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

if __name__ == "__main__":
    sys.meta_path.insert(0, Blocked())
    from inspector.cli.parser import main
    for arguments in json.loads(sys.argv[1]):  # one process for all: most of the time goes into loading what they share
        print("exit code", main(arguments), flush=True)
"""


@pytest.mark.slow
def test_the_core_works_without_the_extras_and_says_which_of_them_a_command_lacks(tmp_path: Path):
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    program = tmp_path / "core.py"
    program.write_text(WITHOUT_EXTRAS.format(extras=modules_of(extras["scans"] + extras["page"])))
    cell = str(ROOT / "sample_data" / "hidden_effect_a")
    words = (
        ("diagnose", cell),
        ("serve", cell),
        ("report", cell, "--out", "r.html"),
        ("simulate", "made", "--robot", "rb5", "--scans"),
    )
    around = {**os.environ, "PYTHONPATH": str(ROOT)}
    told = [sys.executable, program, json.dumps(words)]
    done = subprocess.run(told, cwd=tmp_path, env=around, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["core.py"]
    assert re.findall(r"^exit code (\d)$", done.stdout, re.MULTILINE) == ["0", "2", "2", "2"]
    assert "Verdict: What is missing" in done.stdout
    serve, report, simulate = done.stderr.splitlines()
    assert "needs viser" in serve
    assert "needs plotly" in report
    assert "[scans]" in simulate


@pytest.mark.slow
def test_packages_import_only_what_pyproject_requires():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    allowed = modules_of(project["dependencies"]) | set(sys.stdlib_module_names) | {"calib", "inspector"}
    offered = {name for extra, lines in extras.items() if extra != "test" for name in modules_of(lines)}
    # What a room is built of; commands that need the room load it, and say which extra is missing.
    rooms = {"inspector": modules_of(extras["page"]), "inspector/extras/mcp": modules_of(extras["agent"])}
    foreign = {
        str(path.relative_to(ROOT)): sorted(found)
        for package in ("calib", "inspector")
        for path in python_files(package)
        if (
            found := imported_names(path)
            - allowed
            - (offered - imported_at_once(path))
            - {name for room, names in rooms.items() if path.is_relative_to(ROOT / room) for name in names}
        )
    }
    assert foreign == {}


@pytest.mark.slow
def test_test_files_share_by_support_alone_and_their_folders_are_those_of_packages():
    between = []
    for path in python_files("tests"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and ".test_" in f".{node.module}":
                between.append(f"{path.relative_to(ROOT)} imports {node.module}")
    assert between == []
    tested = {path.parent.relative_to(ROOT / "tests") for path in python_files("tests") if "test_" in path.name}
    tested -= {Path(name) for name in ("docs", "golden", "packaging")}  # of no package
    here = extras()  # one that was taken away leaves its tests behind, which are not collected
    tested -= {folder for folder in tested if folder.parts[:1] == ("extras",) and not {*folder.parts[1:2]} <= {*here}}
    packages = {path.parent for top in ("calib", "inspector") for path in python_files(top)}
    mirrored = {path.relative_to(ROOT / "calib") for path in packages if path.is_relative_to(ROOT / "calib")}
    mirrored |= {path.relative_to(ROOT) for path in packages if path.is_relative_to(ROOT / "inspector")}
    mirrored |= {path.relative_to("inspector") for path in mirrored if path.is_relative_to("inspector/extras")}
    assert {str(folder) for folder in tested - mirrored} == set()


# ---- files ----------------------------------------------------------------------------------------------------------


def test_no_tracked_file_names_a_place_on_somebodys_machine():
    found = []
    for path in tracked_files():
        content = path.read_bytes()
        if b"\0" in content[:8192]:
            continue
        for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines(), start=1):
            if MACHINE_PATH.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}")
    assert found == []


# ---- what README promises -------------------------------------------------------------------------------------------


def test_readme_names_only_commands_and_data_that_exist():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    said = [line.split() for line in re.findall(r"^(?:\$ )?\./run +(.*)", text, re.MULTILINE)]
    names = {words[0] for words in said}
    assert {"serve", "test"} <= names <= {*commands(), "test", "docs", "help"}
    assert [
        word for words in said for word in words if word.startswith("sample_data") and not (ROOT / word).exists()
    ] == []


def test_help_and_documentation_list_every_command_and_option():
    """The page has a section a command, with the table of options, which argparse's own help fills."""
    page = (ROOT / "docs" / "guide" / "commands.md").read_text(encoding="utf-8")
    usage = subprocess.run([ROOT / "run", "help"], capture_output=True, text=True, check=True).stdout
    for command in commands().values():
        assert re.search(rf"\b{command.name}\b", usage), f"./run help does not name {command.name}"
        section = page.partition(f"\n### {command.name}\n")[2].partition("\n### ")[0]
        assert f"`inspector {command.name}" in section, f"no section of {command.name}"
        assert f"```{{command-options}} {command.name}\n```" in section
        told = arguments_of(*declarations(command))
        assert all(one.help for one in told), f"{command.name}: an option without help"
