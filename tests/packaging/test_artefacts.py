"""What `.ci/artefacts.py` refuses in a wheel or an sdist. CI builds real ones; here they are put together by hand."""

from __future__ import annotations

import importlib.util
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from tests.support import ROOT


@pytest.fixture(scope="module")
def artefacts() -> ModuleType:
    spec = importlib.util.spec_from_file_location("artefacts", ROOT / ".ci" / "artefacts.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def names() -> set[str]:
    """The packages' files, the samples, and some that belong into no wheel."""
    files = [path for top in ("calib", "inspector", "sample_data") for path in (ROOT / top).rglob("*")]
    kept = {str(path.relative_to(ROOT)) for path in files if path.is_file() and "__pycache__" not in path.parts}
    return {name for name in kept if not name.endswith(".pyc")} | {"tests/test_jig.py"}


Files = dict[str, bytes]


@pytest.fixture(scope="module")
def right(artefacts: ModuleType, names: set[str]) -> Files:
    """A wheel as it should be."""
    share = f"{artefacts.STEM}.data/data/share/robot-calibration-inspector"
    info = f"{artefacts.STEM}.dist-info"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    code = {n for n in names if n.startswith(("calib/", "inspector/")) and "/pictures/" not in n}
    files = {name: (ROOT / name).read_bytes() for name in code}
    for name in names:
        if name.startswith("sample_data/hidden_effect_"):
            files[f"{share}/{name}"] = (ROOT / name).read_bytes()
    extras = "".join(f"Provides-Extra: {extra}\n" for extra in project["optional-dependencies"])
    files[f"{info}/METADATA"] = (
        f"Metadata-Version: 2.4\nName: {project['name']}\nVersion: {project['version']}\n"
        f"License-Expression: MIT\nRequires-Python: {project['requires-python']}\n{extras}"
        f"Description-Content-Type: text/markdown\n\n# README\n"
    ).encode()
    files[f"{info}/entry_points.txt"] = b"[console_scripts]\ninspector = inspector.__main__:command\n"
    files[f"{info}/licenses/LICENSE"] = (ROOT / "LICENSE").read_bytes()
    return files


def check(artefacts: ModuleType, names: set[str], files: Files, folder: Path) -> None:
    with zipfile.ZipFile(folder / artefacts.WHEEL, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    artefacts.check_wheel(folder / artefacts.WHEEL, names)


def without(name: str) -> Callable[[Files], Files]:
    return lambda files: {key: content for key, content in files.items() if not key.endswith(name)}


def changed(name: str, old: bytes, new: bytes) -> Callable[[Files], Files]:
    return lambda files: {
        key: content.replace(old, new) if key.endswith(name) else content for key, content in files.items()
    }


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (without("calib/robots/rb5.toml"), "lacks .*rb5.toml"),
        (without("inspector/py.typed"), "lacks .*py.typed"),
        (without("hidden_effect_c/points.csv"), "lacks .*hidden_effect_c/points.csv"),
        (lambda files: files | {"tests/test_jig.py": b""}, "has .*tests/test_jig.py"),
        (lambda files: files | {"calib/removed_long_ago.py": b""}, "has .*removed_long_ago"),
        (lambda files: files | {"sample_data/ur10_ipa/points.csv": b""}, "has .*ur10_ipa"),
        (changed("client/page.js", b"inspector", b"inspect"), "others than here: .*page.js"),
        (changed("METADATA", b"\nVersion: ", b"\nVersion: 9"), "metadata say"),
        (changed("METADATA", b"Provides-Extra: page\n", b""), "other extras"),
        (changed("entry_points.txt", b"command", b"main"), "entry point"),
        (changed("licenses/LICENSE", b"MIT", b"GPL"), "another licence"),
    ],
)
def test_a_wrong_wheel_is_refused(
    artefacts: ModuleType,
    names: set[str],
    right: Files,
    tmp_path: Path,
    spoil: Callable[[Files], Files],
    says: str,
):
    with pytest.raises(SystemExit, match=says):
        check(artefacts, names, spoil(right), tmp_path)
