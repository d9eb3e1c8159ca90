"""Several markers at a pose, tables that are turned, and logs of two arms, by an arm whose truth is another code's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from calib import calibrate
from calib.consistency.leading_entry import leading_entry
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset
from calib.frames import apply, best_fit_transform
from calib.kinematics.chain import target_points
from calib.statistics import rms
from inspector.cli.parser import main
from tests.support.commands import refused
from tests.support.recorded_run import NAMES, TOOL_MM, robot_toml, tool_mm

Q = np.random.default_rng(3).uniform([-2.5, -2.2, -2.2, -2.5, -2.0, -2.5], [2.5, -0.4, 2.2, 0.5, 2.0, 2.5], (32, 6))
IDS = [f"P{k}" for k in range(1, 33)]
J = [f"J{k} [deg]" for k in range(1, 7)]
PLACES = {"T1": TOOL_MM, "T2": (-70.0, 25.0, 90.0), "T3": (15.0, 80.0, 40.0)}  # in the last joint's frame


def marker_mm(place: tuple[float, float, float], q: np.ndarray = Q) -> np.ndarray:
    """Another marker's place (N, 3) in the tracker's frame."""
    return tool_mm(q, tool=place)


def measured(name: str, sigma_mm: float = 0.03) -> np.ndarray:
    noise = np.random.default_rng(len(name) + ord(name[-1])).normal(0.0, sigma_mm, (len(Q), 3))
    return marker_mm(PLACES[name]) + noise


def csv(path: Path, rows: Sequence[Sequence[object]], sep: str = ",") -> str:
    cells = [[f"{c:.5f}" if isinstance(c, float) else str(c) for c in row] for row in rows]
    path.write_text("\n".join(sep.join(row) for row in cells) + "\n")
    return str(path)


def made(folder: Path, *given: str) -> Dataset:
    (folder / "robot.toml").write_text(robot_toml())
    assert main(["import", str(folder / "cell"), "--robot", str(folder / "robot.toml"), *given]) == 0
    return load_dataset(folder / "cell")


def held_out_mm(dataset: Dataset) -> float:
    q = np.random.default_rng(9).uniform(-2.0, 2.0, (200, 6))
    mine, true = target_points(calibrate(dataset).robot, q), tool_mm(q)
    return rms(apply(best_fit_transform(mine, true), mine) - true)


def wide(names: Sequence[str]) -> list[list[object]]:
    head: list[object] = ["pose", *J, *(f"{name}_{axis}" for name in names for axis in "xyz")]
    seen = [measured(name) for name in names]
    return [head, *([IDS[i], *np.degrees(Q[i]), *(v for each in seen for v in each[i])] for i in range(len(Q)))]


def test_markers_of_a_row_are_targets_at_their_places(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dataset = made(tmp_path, "--joints", csv(tmp_path / "t.csv", wide(list(PLACES))))
    assert "the tool's point, jig, is T1; further targets are T2, T3" in capsys.readouterr().out
    assert dataset.points is not None
    assert len(dataset.points) == 3 * len(Q)
    robot = calibrate(dataset).robot
    for name in ("T2", "T3"):
        assert np.abs(np.array(robot.target(name).xyz_mm) - PLACES[name]).max() < 0.1
    assert held_out_mm(dataset) < 0.02  # 0.04 with one of the three
    assert main(["calibrate", str(tmp_path / "cell")]) == 0


def test_targets_that_stand_or_are_of_no_link_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    joints = csv(tmp_path / "joints.csv", [["pose", *J], *([IDS[i], *np.degrees(Q[i])] for i in range(len(Q)))])
    rng = np.random.default_rng(1)
    seen = {
        "smr": measured("T1"),
        "nest": rng.normal(0.0, 0.03, (32, 3)) + 900.0,
        "hand": rng.normal(0.0, 400.0, (32, 3)),
    }
    rows = [[IDS[i], name, *xyz[i]] for i in range(32) for name, xyz in seen.items()]
    points = csv(tmp_path / "points.csv", [["pose", "target", "x_mm", "y_mm", "z_mm"], *rows])
    dataset = made(tmp_path, "--joints", joints, "--points", points)
    out = capsys.readouterr()
    assert "points that stand still are left out: nest" in out.out
    assert "target hand is fixed to no link of this arm" in out.err
    assert set(dataset.points.target) == {"jig"}


def test_columns_at_one_place_are_repeats(tmp_path: Path) -> None:
    seen = [measured("T1"), measured("T1") + np.random.default_rng(8).normal(0.0, 0.03, (32, 3))]
    head = ["pose", *J, *(f"{axis}{k}" for k in (1, 2) for axis in "xyz")]
    rows = [[IDS[i], *np.degrees(Q[i]), *seen[0][i], *seen[1][i]] for i in range(32)]
    dataset = made(tmp_path, "--joints", csv(tmp_path / "t.csv", [head, *rows]))
    assert set(dataset.points.target) == {"jig"}
    assert len(dataset.points) == 64


def test_a_table_with_a_column_a_pose_is_turned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows: list[Sequence[object]] = [["Cell 3"], ["", "", *IDS]]
    rows += [[f"Achse {k + 1}", "°", *np.degrees(Q[:, k])] for k in range(6)]
    rows += [[axis, "mm", *measured("T1")[:, k]] for k, axis in enumerate("XYZ")]
    dataset = made(tmp_path, "--joints", csv(tmp_path / "t.csv", [*rows, ["Remark: all well"]]))
    assert "each pose is a column: it is turned" in capsys.readouterr().out
    assert dataset.poses.ids == tuple(IDS)
    assert np.abs(dataset.poses.q - Q).max() < 1e-6
    assert held_out_mm(dataset) < 0.05


def test_a_log_of_two_arms_tells_what_to_type(tmp_path: Path) -> None:
    head = ["pose", *(f"{arm}_{name}" for arm in ("left", "right") for name in NAMES), "x", "y", "z"]
    rows = [[IDS[i], *Q[-1 - i], *Q[i], *measured("T1")[i]] for i in range(32)]
    table = csv(tmp_path / "t.csv", [head, *rows])
    (tmp_path / "robot.toml").write_text(robot_toml())
    assert "say which by --map 'left_*=q*' or --map 'right_*=q*'" in refused(
        "import", tmp_path / "cell", "--robot", tmp_path / "robot.toml", "--joints", table
    )
    assert np.abs(made(tmp_path, "--joints", table, "--map", "right_*=q*").poses.q - Q).max() < 1e-5


def test_an_entry_is_judged_with_the_tools_own_point(tmp_path: Path) -> None:
    """Of an arm whose tool is where the file says, no entry behind it is told to be off by the tool's length."""
    text = robot_toml().replace(f"[tool]\nxyz_mm = {list(TOOL_MM)}", "[tool]\nxyz_mm = [0.0, 0.0, 0.0]")
    (tmp_path / "robot.toml").write_text(text + f'\n[[targets]]\nname = "jig"\nxyz_mm = {list(TOOL_MM)}\n')
    table = csv(tmp_path / "t.csv", wide(["T1"]))
    assert main(["import", str(tmp_path / "cell"), "--robot", str(tmp_path / "robot.toml"), "--joints", table]) == 0
    found = leading_entry(calibrate(load_dataset(tmp_path / "cell")))
    assert found is None or found.parameter not in ("d6", "dTCP", "aTCP")
