"""`inspector sample`: the datasets that come with the package, listed and written."""

from __future__ import annotations

import shutil
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from inspector.cli.robots import sample_command
from tests.support.commands import answered, printed, refused

SAMPLE_DATA = Path(__file__).parents[4] / "sample_data"
SHIPPED = ("hidden_effect_a", "hidden_effect_b", "hidden_effect_c")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return Path.cwd()


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installation such as pip makes of the wheel: share/ beside lib/, told by the distribution's RECORD."""
    lib = tmp_path / "env/lib/python3/site-packages"
    record = lib / "robot_calibration_inspector-1.0.0.dist-info/RECORD"
    record.parent.mkdir(parents=True)
    below = Path("share/robot-calibration-inspector/sample_data/hidden_effect_b")
    shutil.copytree(SAMPLE_DATA / "hidden_effect_b", tmp_path / "env" / below)
    lines = [f"../../../{below}/{file.name},," for file in (tmp_path / "env" / below).iterdir()]
    record.write_text("\n".join(["inspector/__init__.py,,", *lines]))
    (record.parent / "METADATA").write_text("Metadata-Version: 2.1\nName: robot-calibration-inspector\n")
    distribution = metadata.PathDistribution(record.parent)
    monkeypatch.setattr(sample_command.metadata, "files", lambda name: distribution.files)
    return tmp_path / "env"


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_checkout_lists_all_of_sample_data():
    told = {sample["name"]: sample["about"] for sample in answered("sample")["samples"]}
    folders = {path.parent.name: path for path in SAMPLE_DATA.glob("*/dataset.toml")}
    assert told == {name: tomllib.loads(path.read_text())["description"] for name, path in folders.items()}


@pytest.mark.parametrize("name", SHIPPED)
def test_a_sample_is_written_as_it_is(name: str, here: Path):
    printed("sample", name)
    assert content(here) == {f"{name}/{file}": text for file, text in content(SAMPLE_DATA / name).items()}


def test_out_names_another_folder_whose_parents_are_made(here: Path):
    assert answered("sample", "hidden_effect_a", "--out", "a/new/cell") == {
        "sample": "hidden_effect_a",
        "dataset": "a/new/cell",
    }
    assert content(here / "a/new/cell") == content(SAMPLE_DATA / "hidden_effect_a")
    assert [path.name for path in (here / "a/new").iterdir()] == ["cell"], "nothing else is left there"


def test_an_installation_has_what_its_record_names(installed: Path, here: Path):
    assert [line.split()[0] for line in printed("sample").splitlines()] == ["hidden_effect_b"]
    (installed / "share/robot-calibration-inspector/sample_data/hidden_effect_b").chmod(0o555)  # as of another user
    printed("sample", "hidden_effect_b")
    assert content(here / "hidden_effect_b") == content(SAMPLE_DATA / "hidden_effect_b")
    (here / "hidden_effect_b" / "more").touch()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["hidden_effect_d"], "hidden_effect_d: no such sample; there are hidden_effect_a, "),
        (["hidden_effect_a", "--out", "full"], "full: exists and is not empty"),
        (["hidden_effect_a", "--out", "full/file"], "full/file: exists and is not empty"),
        (["hidden_effect_a", "--out", "full/file/below"], "full/file/below: cannot be written"),
        (["--out", "x"], "--out: name the sample"),
    ],
)
def test_what_cannot_be_done_is_one_line(arguments: list[str], says: str, here: Path):
    (here / "full").mkdir()
    (here / "full/file").write_text("mine")
    said = refused("sample", *arguments)
    assert said.startswith(f"inspector: {says}")
    assert content(here) == {"full/file": b"mine"}


def test_an_installation_without_samples_says_what_would_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sample_command, "_CHECKOUT", tmp_path)
    monkeypatch.setattr(sample_command.metadata, "files", lambda name: None)
    assert "inspector simulate" in refused("sample")
