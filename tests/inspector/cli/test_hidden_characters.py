"""Every command's output on a dataset whose names hide something: nothing hidden reaches terminal, page or file."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from calib.dataset.files.folder import load_dataset
from calib.errors import visible
from calib.options import FitOptions
from calib.planning.plan import plan_poses
from calib.planning.start import start_of_dataset
from inspector.cli.parser import main
from inspector.export.plan_files import planned_file
from tests.support.commands import printed, refused
from tests.support.fleet import ENOUGH, write_cell
from tests.support.robot_texts import UR_YAML

pytestmark = pytest.mark.slow

HIDDEN = "x\x1b[31m\u202egpj.\u200bz"


def seen(text: str) -> None:
    """A text has nothing hidden."""
    assert visible(text, kept="\n\r\t") == text


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A dataset in a folder whose name hides something."""
    write_cell(tmp_path / "plain", 3, ENOUGH, serial="S1", lot="17")
    shutil.move(tmp_path / "plain", tmp_path / "fleet" / HIDDEN)
    return tmp_path / "fleet" / HIDDEN


@pytest.mark.parametrize(
    "command",
    [
        ["calibrate"], ["calibrate", "--json"], ["redundancy"], ["diagnose"], ["diagnose", "--json"],
        ["check"], ["validate"], ["plan", "--poses", "8"], ["check", "/nowhere/" + HIDDEN],
        ["import", "--from"], ["convert"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_terminal_shows_what_is_hidden(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    if command[0] == "import":
        main(["import", str(tmp_path / "made"), "--from", str(cell)])
    elif command[0] == "convert":
        assert main(["convert", str(cell / "robot.toml"), str(tmp_path / f"{HIDDEN}.yaml")]) == 0
    else:
        main([command[0], *([str(cell)] if len(command) < 2 or command[1][0] == "-" else []), *command[1:]])
    said = capsys.readouterr()
    seen(said.out)
    seen(said.err)
    assert said.out or said.err


def test_files_that_are_written_show_it_too(cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    printed("report", cell, "--out", out / "report.html")
    outputs = ["--out", str(out / "robot.toml"), "--model-out", str(out / "model.json"), "--force"]
    printed("calibrate", cell, *outputs)
    planned = plan_poses(start_of_dataset(load_dataset(cell), FitOptions()), 8, candidates=60)
    (out / "plan.csv").write_text(planned_file(planned), "utf-8")
    files = [path for path in out.rglob("*") if path.is_file()]
    assert len(files) >= 4
    for path in files:
        seen(path.read_text("utf-8"))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("arm.urdf", '<robot name="a"><link name="b"/><link name="l"/><joint name="j&#x202e;" type="continuous">'
         '<parent link="b"/><child link="l"/></joint></robot>'),
        ("arm.urdf", '<robot name="a&#x200b;"><link name="b"/><link name="l"/><joint name="j" type="continuous">'
         '<parent link="b"/><child link="l"/></joint></robot>'),
        ("arm.yaml", UR_YAML.replace("shoulder:", "shoulder\u202e:")),
    ],
)  # fmt: skip
def test_robots_have_no_such_names(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    seen(refused("convert", tmp_path / name, tmp_path / "out.toml"))
    assert not (tmp_path / "out.toml").exists()
