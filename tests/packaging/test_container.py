"""The Dockerfile, read line by line and held against the code; .github/workflows/artefacts.yml builds the image."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

from inspector.cli.commands import commands
from inspector.cli.parser import parser_of
from tests.support import ROOT

TEXT = (ROOT / "Dockerfile").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def instructions() -> list[tuple[str, str]]:
    """Each instruction and what it is given, in order; lines that go on are joined."""
    plain = re.sub(r"\\\n\s*", " ", re.sub(r"^#.*\n", "", TEXT, flags=re.MULTILINE))
    return [(line.split()[0], line.partition(" ")[2].strip()) for line in plain.splitlines() if line]


STEPS = instructions()


def given(name: str) -> str:
    """What the last instruction of this name is given."""
    return [text for step, text in STEPS if step == name][-1]


def port() -> str:
    return given("EXPOSE")


def test_it_runs_as_a_user_of_its_own():
    names = [step for step, _ in STEPS]
    assert names.index("USER") < names.index("ENTRYPOINT")
    assert not {"RUN", "COPY", "ADD"} & set(names[names.index("USER") :]), "the user owns nothing of the program"
    assert re.search(rf"useradd .*\b{given('USER')}$", "\n".join(text for step, text in STEPS if step == "RUN"))


def test_what_it_starts_is_the_server_on_the_folder_that_is_mounted():
    entry, words = json.loads(given("ENTRYPOINT")), json.loads(given("CMD"))
    assert entry == [*PROJECT["scripts"]]
    asked = vars(parser_of(commands().values()).parse_args(words))
    assert asked["command"].name == "serve"
    assert asked["path"] == Path(given("WORKDIR")) == Path("/data")
    assert (asked["host"], str(asked["port"])) == ("0.0.0.0", port()), "a port of the container reaches no loopback"


def test_its_steps_are_shell_and_name_the_systems_libraries_of_run():
    for step, text in STEPS:
        if step == "RUN":
            command = re.sub(r"^--mount=\S+\s+", "", text)
            done = subprocess.run([shutil.which("sh") or "sh", "-n", "-c", command], capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
    (libraries,) = re.findall(r"^libraries='([^']*)'", (ROOT / "run").read_text(), re.MULTILINE)
    assert f"--no-install-recommends {libraries} &&" in re.sub(r"\s+", " ", TEXT.replace("\\\n", " "))


def test_its_python_and_extras_are_the_projects():
    images = {text.split()[0] for step, text in STEPS if step == "FROM"}
    assert len(images) == 1
    version = re.fullmatch(r"python:(3\.\d+)-slim-\w+", images.pop())
    assert version
    assert f"Programming Language :: Python :: {version[1]}" in PROJECT["classifiers"]
    extras = set(given("ARG").removeprefix("EXTRAS=").split(","))
    assert "page" in extras <= set(PROJECT["optional-dependencies"])
