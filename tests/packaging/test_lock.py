"""The locked environment, requirements/locked.txt, held against pyproject.toml for each Python and system."""

from __future__ import annotations

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from tests.support import ROOT

LOCK = (ROOT / "requirements" / "locked.txt").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
SYSTEMS = (("linux", "x86_64"), ("linux", "aarch64"), ("darwin", "arm64"))


def environment(python: str, system: str, machine: str) -> dict[str, str]:
    """What markers ask of an interpreter."""
    return {
        "python_version": python,
        "python_full_version": f"{python}.1",
        "sys_platform": system,
        "platform_machine": machine,
        "platform_system": {"linux": "Linux", "darwin": "Darwin"}[system],
        "os_name": "posix",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        "extra": "",
    }


def entries() -> list[tuple[Requirement, list[str]]]:
    """The pins, each with its hashes."""
    joined = re.sub(r"\\\n\s*", " ", re.sub(r"^\s*#.*\n", "", LOCK, flags=re.MULTILINE))
    found = []
    for line in filter(None, joined.splitlines()):
        requirement, *hashes = re.split(r"\s--hash=", line)
        found.append((Requirement(requirement.strip()), [text.strip() for text in hashes]))
    return found


def wanted(extra: str) -> list[Requirement]:
    """All that the project asks for with an extra, the extras that it names included."""
    lines = [Requirement(line) for line in PROJECT["optional-dependencies"][extra]]
    own = [line for line in lines if line.name == PROJECT["name"]]
    others = [line for line in lines if line.name != PROJECT["name"]]
    return others + [line for one in own for extra in sorted(one.extras) for line in wanted(extra)]


PINS = entries()


def test_the_lock_holds_names_versions_and_hashes_and_no_address():
    assert len(PINS) > 100
    for pin, hashes in PINS:
        assert re.fullmatch(r"==[^*,]+", str(pin.specifier)), pin
        assert pin.url is None
        assert hashes, f"{pin.name} has no hash"
        assert all(re.fullmatch(r"sha256:[0-9a-f]{64}", text) for text in hashes), pin.name
    assert not re.search(r"https?:|file:|--(?:index|extra|find)", LOCK), "an address is no business of a lock"


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize("system", SYSTEMS, ids="-".join)
def test_the_lock_satisfies_pyproject(python: str, system: tuple[str, str]):
    here = environment(python, *system)
    chosen: dict[str, Version] = {}
    for pin, _ in PINS:
        if pin.marker is None or pin.marker.evaluate(here):
            name = re.sub(r"[-_.]+", "-", pin.name).lower()
            assert name not in chosen, f"{name} is pinned twice"
            chosen[name] = Version(str(pin.specifier).removeprefix("=="))
    for requirement in [*map(Requirement, PROJECT["dependencies"]), *wanted("test")]:
        if requirement.marker is None or requirement.marker.evaluate(here):
            name = re.sub(r"[-_.]+", "-", requirement.name).lower()
            assert name in chosen, f"the lock lacks {requirement}: run .ci/lock"
            assert chosen[name] in requirement.specifier, f"{requirement}, locked is {chosen[name]}: run .ci/lock"


def test_the_lock_is_read_by_what_its_head_says():
    command = re.search(r"^#\s+(\S+)$", LOCK, flags=re.MULTILINE)
    assert command
    assert (ROOT / command[1]).stat().st_mode & 0o111
