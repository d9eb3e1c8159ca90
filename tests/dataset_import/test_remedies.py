"""What an import says of a table with one fault, and that its own advice, followed on that table, takes it in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from inspector.cli.parser import main
from tests.support.commands import refused
from tests.support.public_forms import DEG, POINTS, J, text
from tests.support.recorded_run import robot_toml

ROWS = slice(0, 16)
JOINTS, PLACES = DEG[ROWS].T, POINTS[ROWS].T
MAPS = [f"--map={name}=q{k}_deg" for k, name in enumerate((f"J{k}_rad" for k in range(1, 7)), 1)]


def imported(folder: Path, head: Sequence[str], columns: Sequence[np.ndarray], *more: str, robot: str = "") -> int:
    """Exit code of an import of a table of these columns."""
    (folder / "robot.toml").write_text(robot_toml())
    table = text(folder / "all.csv", [",".join(head)], columns)
    return main(
        ["import", str(folder / "cell"), "--robot", robot or str(folder / "robot.toml"), "--joints", table, *more]
    )


@pytest.mark.parametrize(
    ("head", "columns", "says", "remedy"),
    [
        (
            [f"{name}_rad" for name in J] + [*"xyz"], [*JOINTS, *PLACES],
            "are named rad and hold deg: the error falls from", MAPS,
        ),
        ([*J, *"xyz"], [*JOINTS, *PLACES * [[1], [-1], [1]]], "or the points are mirrored", ["--map=x=y", "--map=y=x"]),
        (
            [*J, "tcp_x", "tcp_y", "tcp_z"], [*JOINTS, *PLACES],
            "--map 'tcp_x=x' --map 'tcp_y=y' --map 'tcp_z=z'", [f"--map=tcp_{axis}={axis}" for axis in "xyz"],
        ),
    ],
    ids=["unit", "mirrored", "own pose"],
)  # fmt: skip
def test_a_remedy_works_on_the_table_that_it_is_told_of(
    head: list[str], columns: list[np.ndarray], says: str, remedy: list[str], tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    imported(tmp_path, head, columns)
    assert says in capsys.readouterr().err
    if (tmp_path / "cell").exists():
        (tmp_path / "cell").rename(tmp_path / "before")
    assert imported(tmp_path, head, columns, *remedy) == 0
    assert "warning" not in capsys.readouterr().err


def test_another_robot_is_doubted_and_not_read_by_turned_joints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, [*J, *"xyz"], [*JOINTS, *PLACES], robot="rb5") == 0
    said = capsys.readouterr()
    assert "warning" in said.err
    assert "is read so" not in said.out


@pytest.mark.parametrize(
    ("head", "columns", "says"),
    [
        ([*J, *"xy"], [*JOINTS, *PLACES[:2]], "all.csv: line 1: no column for z beside x, y"),
        ([";".join([*J, *"xyz"])], [*JOINTS, *PLACES], "line 1: found 1 names and 9 cells in line 2"),
        ([*(f"{name}_mm" for name in J), *"xyz"], [*JOINTS, *PLACES], "is by --map 'J1_mm=q1_deg'"),
        (
            [*J, "x_mm", "y_mm", "z_m"],
            [*JOINTS, *PLACES],
            "say so by --map 'x_mm=x_mm' --map 'y_mm=y_mm' --map 'z_m=z_mm'",
        ),
        ([*J, *"xyz"], [*JOINTS, *PLACES[:, :1].repeat(16, 1)], "x, y, z are the same at all 16 poses"),
    ],
)
def test_what_is_wrong_is_told_with_a_place_that_is_there(
    head: list[str], columns: list[np.ndarray], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(tmp_path, head, columns) == 2
    assert says in capsys.readouterr().err


def test_one_file_of_many_that_differs_and_a_robot_that_is_none_are_named(tmp_path: Path) -> None:
    for k in range(5):
        (tmp_path / f"{k}.txt").write_text(" ".join(map(str, range(5 if k == 3 else 6))))
    asked = ("--joints", tmp_path / "*.txt")
    assert "3.txt: found 5 numbers" in refused("import", tmp_path / "cell", "--robot", "rb5", *asked)
    assert "no built-in robot; there are rb5" in refused("where", "ur99", "--joints=0,0")
