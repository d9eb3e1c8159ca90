"""Input that no one meant to give: each is one line that names its place, exit code 2, and nothing is half-written."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import load_robot_toml
from calib.simulation import simulate
from inspector.cli import dataset_commands as commands
from inspector.cli.parser import main
from tests.support.arms import dataset_of, jang_arm, perturbed
from tests.support.commands import printed, refused


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(0)
    folder = tmp_path_factory.mktemp("good") / "cell"
    robot = jang_arm()
    write_dataset(dataset_of(robot, perturbed(robot, rng), rng, poses=30, test=6, noise_mm=0.03), folder)
    return folder


@pytest.fixture
def cell(good: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy to spoil; what the command was to leave alone is held against the original."""
    folder = tmp_path / "cell"
    shutil.copytree(good, folder)
    yield folder
    hidden = [path for path in tmp_path.rglob(".*") if path.name.endswith(".part")]
    assert not hidden


def files_of(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("noise_mm", ["1e-9", "1e9", "-0.1", "nan", "inf"])
def test_simulate_writes_no_dataset_that_cannot_be_read(tmp_path: Path, noise_mm: str) -> None:
    line = refused("simulate", tmp_path / "cell", "--robot", "rb5", "--noise-mm", noise_mm)
    assert f"--noise-mm {noise_mm.replace('e-9', 'e-09').replace('e9', 'e+09')}: give 0, or 1e-06 to 1000 mm" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (["calibrate", "--out"], "robot.toml"),
        (["calibrate", "--out"], "dataset.toml"),
        (["calibrate", "--residuals"], "points.csv"),
        (["calibrate", "--session"], "dataset.toml"),
        (["redundancy", "--out"], "points.csv"),
        (["correct", "--joints", "poses.csv", "--out"], "poses.csv"),
        (["report", "--force", "--out"], "robot.toml"),
    ],
)
def test_no_output_takes_the_place_of_the_datasets_files(
    good: Path,
    cell: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: list[str],
    name: str,
) -> None:
    """Also by another way to it: a calibrated robot.toml there would be taken for the nominal one the next time."""
    monkeypatch.chdir(cell)
    link = cell.parent / "link"
    link.symlink_to(cell / name)
    for path in (cell / name, Path("..") / "cell" / name, link):
        line = refused(command[0], cell, *command[1:], path)
        assert str(path) in line
        assert "file of the dataset test" in line or "no report" in line
    assert files_of(cell) == files_of(good)


def test_no_output_takes_the_place_of_other_inputs_nor_of_another_output(cell: Path, tmp_path: Path) -> None:
    targets = tmp_path / "targets.csv"
    shutil.copy(cell / "poses.csv", targets)
    line = refused("correct", cell, "--joints", targets, "--out", targets)
    assert "targets.csv: is what" in line
    assert targets.read_bytes() == (cell / "poses.csv").read_bytes()
    effects = tmp_path / "mine.py"
    effects.write_text("raise SystemExit\n")
    assert "this command reads" in refused("calibrate", cell, "--effects-file", effects, "--out", effects)
    out = tmp_path / "x"
    assert "written twice" in refused("calibrate", cell, "--out", out, "--residuals", out)
    assert not out.exists()
    printed("calibrate", cell, "--out", "/dev/null", "--residuals", "/dev/null")


@pytest.mark.slow
def test_a_disk_that_is_full_is_told_with_the_files_name(
    cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "robot.toml"
    out.write_text("as it was")

    def full(_fd: int, _mode: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr("calib.dataset.files.atomic_write.os.chmod", full)
        line = refused("calibrate", cell, "--out", out)
    assert f"{out}: cannot be written (No space left" in line
    assert out.read_text() == "as it was"
    below_a_file = out / "deeper" / "robot.toml"
    assert f"{below_a_file}: cannot be written (Not a dir" in refused("calibrate", cell, "--out", below_a_file)
    long = tmp_path / ("x" * 250)
    printed("calibrate", cell, "--out", long)  # its temporary name has to be one too
    assert long.is_file()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("a_mm = 425.0", "a_mm = 1e300", "[[joints]] 2.a_mm: found 1e+300, beyond 1e+06"),
        ("d_mm = 169.2", "d_mm = -2e6", "[[joints]] 1.d_mm: found -2e+06, beyond 1e+06"),
        ("alpha_deg = -90.0", "alpha_deg = 1e17", "[[joints]] 1.alpha_deg: found 1e+17, beyond 100000"),
        ("    -9.81,", "    -9810.0,", "gravity_m_s2: found [0.0, 0.0, -9810.0], beyond 100"),
        ('name = "J1"', 'name = "J1"\nmass_kg = 1e12', "[[joints]] 1.mass_kg: found 1e+12, beyond 100000"),
        (
            'name = "J1"',
            'name = "J1"\ncom_mm = [0.0, 1e9, 0.0]',
            "[[joints]] 1.com_mm: found [0.0, 1000000000.0, 0.0], beyond",
        ),
        ('name = "J1"', 'name = "J1"\nmin_deg = -1e9', "[[joints]] 1.min_deg: found -1e+09, beyond 100000"),
        (
            "[tool]",
            '[[targets]]\nname = "b"\nxyz_mm = [1e7, 0.0, 0.0]\n[tool]',
            "[[targets]] 1.xyz_mm: found [100",
        ),
    ],
)
def test_a_size_that_no_arm_has_is_told_by_its_key(cell: Path, tmp_path: Path, old: str, new: str, says: str) -> None:
    path = cell / "robot.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    load_robot_toml(path)  # well-formed as far as the file goes
    assert f"robot.toml: {says}" in refused("calibrate", cell)
    assert f"robot.toml: {says}" in refused("simulate", tmp_path / "new", "--robot", path)
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left on device"), RuntimeError])
@pytest.mark.parametrize("was_there", [False, True])
def test_a_simulation_that_is_stopped_leaves_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    stop: type[BaseException] | BaseException,
    was_there: bool,
) -> None:
    """Else the next try with the same name is told that it exists and is not empty."""
    written: list[Path] = []
    write_scan = simulate.write_scan

    def fails_at_the_second(path: Path, scan: object) -> None:
        if written:
            raise stop
        write_scan(path, scan)  # type: ignore[arg-type]
        written.append(path)

    folder = tmp_path / "cell"
    if was_there:
        folder.mkdir()
    arguments = ["simulate", str(folder), "--robot", "rb5", "--poses", "3", "--scans"]
    with monkeypatch.context() as patched:
        patched.setattr(simulate, "write_scan", fails_at_the_second)
        assert main(arguments) in (2, 130)
    assert len(written) == 1
    assert folder.exists() == was_there
    assert list(tmp_path.rglob("*")) == ([folder] if was_there else [])
    assert main(arguments) == 0
    assert len(load_dataset(folder).poses) == 3


def test_a_folder_or_a_file_in_the_others_place(cell: Path) -> None:
    assert "is a folder" in refused("correct", cell, "--joints", cell, "--out", cell.parent / "out.csv")
    for command in ("check", "calibrate", "corners", "diagnose", "redundancy", "validate"):
        assert "poses.csv: is a file; " in refused(command, cell / "poses.csv")


def test_targets_may_come_through_a_pipe(cell: Path, tmp_path: Path) -> None:
    """As in --joints <(make_targets): what is no file can be read all the same."""
    read, write = os.pipe()
    with os.fdopen(write, "w") as pipe:
        pipe.write(",".join(f"q{k + 1}_deg" for k in range(6)) + "\n10,20,30,40,50,60\n")
    out = tmp_path / "out.csv"
    printed("correct", cell, "--joints", f"/dev/fd/{read}", "--out", out)
    os.close(read)
    assert out.read_text().count("\n") == 2


def test_no_process_is_started_where_there_is_no_scan(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []
    processes = commands.processes

    def noticed(scans: int, wanted: int | None = None) -> object:
        started.append(scans)
        return processes(scans, wanted)

    monkeypatch.setattr(commands, "processes", noticed)
    assert "has no scans" in refused("corners", cell)
    assert set(started) == {0}
