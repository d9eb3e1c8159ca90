"""The conda recipe, the ROS 2 package and the paper say the same as pyproject.toml and the documentation."""

from __future__ import annotations

import ast
import re
import tomllib
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement

from tests.support import ROOT

yaml = pytest.importorskip("yaml")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ROS = ROOT / "release" / "ros2" / "robot_calibration_inspector_ros"


def test_the_conda_recipe_asks_for_what_the_wheel_asks_for() -> None:
    recipe = yaml.safe_load((ROOT / "release" / "conda" / "recipe.yaml").read_text())
    assert recipe["context"]["version"] == PROJECT["version"]
    wanted = {Requirement(one) for one in [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["page"]]}
    python, *others = (Requirement(one) for one in recipe["requirements"]["run"])
    assert str(python.specifier) == PROJECT["requires-python"]
    assert {(one.name, one.specifier) for one in others} == {(one.name, one.specifier) for one in wanted}
    (entry,) = recipe["build"]["python"]["entry_points"]
    assert entry == f"inspector = {PROJECT['scripts']['inspector']}"


def test_the_ros_package_is_of_this_version_and_its_files_exist() -> None:
    package = ElementTree.parse(ROS / "package.xml").getroot()
    assert package.findtext("name") == ROS.name
    assert package.findtext("version") == PROJECT["version"]
    setup = (ROS / "setup.py").read_text()
    assert f"{PROJECT['name']}[page,logs,xacro]=={PROJECT['version']}" in setup
    assert (ROS / "resource" / ROS.name).is_file()
    for file in (ROS / "launch" / "page.launch.py", ROS / "setup.py"):
        ast.parse(file.read_text())


def test_figures_of_the_paper_are_those_of_the_documentation() -> None:
    paper = (ROOT / "paper" / "paper.md").read_text()
    pages = [ROOT / "docs" / name for name in ("measured.md", "field.md", "extras/camera.md")]
    told = " ".join(page.read_text() for page in pages)
    table = [line for line in paper.splitlines() if line.startswith("| ") and "reference" not in line]
    figures = {figure for line in table for figure in re.findall(r"\d+\.\d+", line)}
    assert len(figures) > 10
    assert {figure for figure in figures if figure not in told} == set()
