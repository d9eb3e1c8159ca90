"""What the project says of itself in files that other programs read: hooks, workflows, citation, changelog, groups."""

from __future__ import annotations

import re
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.version import Version

from tests.support import ROOT

yaml = pytest.importorskip("yaml")

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def loaded(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def run_says(name: str) -> str:
    """The value of a variable that `run` sets at its top."""
    (value,) = re.findall(rf"^{name}='?([^'#\n]*?)'?\s*(?:#.*)?$", (ROOT / "run").read_text(), re.MULTILINE)
    return value


def pythons() -> list[str]:
    """The versions of Python that the classifiers name."""
    names = [name.rpartition(" ")[2] for name in PROJECT["classifiers"] if "Python :: 3." in name]
    return sorted(names, key=Version)


# ---- pythons, groups, tools -----------------------------------------------------------------------------------------


def test_all_name_the_same_pythons():
    first, last = f"3.{run_says('oldest')}", f"3.{run_says('newest')}"
    assert pythons() == [f"3.{minor}" for minor in range(int(first[2:]), int(last[2:]) + 1)]
    assert str(SpecifierSet(PROJECT["requires-python"])) == f">={first}", "no upper bound"
    matrices = [
        job["strategy"]["matrix"]["python"]
        for path in WORKFLOWS
        for job in loaded(path)["jobs"].values()
        if "strategy" in job
    ]
    assert matrices
    assert all(matrix == pythons() for matrix in matrices)
    assert PYPROJECT["tool"]["mypy"]["python_version"] == first, "types are checked as the oldest has them"


def test_groups_and_extras_name_what_there_is():
    own = [
        line if isinstance(line, str) else None for lines in PYPROJECT["dependency-groups"].values() for line in lines
    ]
    named = [Requirement(line) for line in [*own, *(line for lines in EXTRAS.values() for line in lines)] if line]
    for requirement in named:
        if requirement.name == PROJECT["name"]:
            assert requirement.extras <= set(EXTRAS), requirement
    included = {
        line["include-group"]
        for lines in PYPROJECT["dependency-groups"].values()
        for line in lines
        if isinstance(line, dict)
    }
    assert included <= set(PYPROJECT["dependency-groups"])
    assert {"test", "docs", "dev"} <= set(PYPROJECT["dependency-groups"]), "those that uv and pip look for"


def test_hooks_use_the_ruff_that_the_tests_use():
    hooks = loaded(ROOT / ".pre-commit-config.yaml")["repos"]
    (revision,) = [repo["rev"] for repo in hooks if repo["repo"].endswith("/ruff-pre-commit")]
    (ruff,) = [Requirement(line) for line in EXTRAS["test"] if line.startswith("ruff")]
    assert Version(revision) in ruff.specifier
    local = [hook for repo in hooks if repo["repo"] == "local" for hook in repo["hooks"]]
    assert all(hook["entry"].split()[0].startswith(".venv/bin/") for hook in local)


def test_read_the_docs_builds_what_run_docs_builds():
    said = loaded(ROOT / ".readthedocs.yaml")
    assert (ROOT / said["sphinx"]["configuration"]).is_file()
    assert said["build"]["apt_packages"] == run_says("libraries").split()
    assert set(said["python"]["install"][0]["extra_requirements"]) == {"scans", "page", "docs"}
    assert said["build"]["tools"]["python"] in pythons()


# ---- workflows ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_calls_programs_of_the_project_and_pinned_actions(path: Path):
    workflow = loaded(path)
    assert workflow["permissions"] == {"contents": "read"}
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    for step in steps:
        for word in re.findall(r"(?<!\S)(?:\./|\.ci/)\S+", step.get("run", "")):
            program = ROOT / word
            assert program.is_file(), word
            assert program.stat().st_mode & 0o111, f"{word} is not executable"
        if "uses" in step:
            assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", step["uses"]), "a tag may be moved, a commit may not"
        if step.get("uses", "").startswith("actions/checkout@"):
            assert step["with"]["persist-credentials"] is False
    assert all(job["timeout-minutes"] <= 200 for job in workflow["jobs"].values()), "a hanging job ends"


# ---- CITATION.cff and CHANGELOG.md ----------------------------------------------------------------------------------


def headings() -> list[str]:
    """The changelog's headings below its title."""
    return re.findall(r"^##+ .*$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)


def test_the_changelog_keeps_its_form():
    """As https://keepachangelog.com/en/1.1.0/ has it: Unreleased, then versions with dates, the latest first."""
    versions = [line.removeprefix("## ") for line in headings() if line.startswith("## ")]
    assert versions[0] == "[Unreleased]"
    released = [re.fullmatch(r"\[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)", text) for text in versions[1:]]
    assert all(released), versions
    numbers = [Version(match[1]) for match in released if match]
    dates = [date.fromisoformat(match[2]) for match in released if match]
    assert numbers == sorted(set(numbers), reverse=True)
    assert dates == sorted(dates, reverse=True)
    assert all(number <= Version(PROJECT["version"]) for number in numbers), "pyproject.toml has an older version"
