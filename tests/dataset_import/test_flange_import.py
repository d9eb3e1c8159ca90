"""Poses of the flange with points or alone at one tip, and drives by their readings, simulated by scipy's rotations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset_import.drives import drives_in_words
from calib.dataset_import.plan import ImportSources, plan_import
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile
from calib.text_files.user_table import load_table
from tests.support.commands import answered, printed, refused

BASE = np.array([1500.0, -300.0, 200.0])
TOOL = np.array([12.0, -35.0, 180.0])
INSTRUMENT = Rotation.from_euler("xyz", [0.1, 0.2, 1.3])


def table(path: Path, names: str, columns: str, rows: np.ndarray) -> Path:
    lines = [f"{names}{k},{','.join(f'{value:.5f}' for value in row)}" for k, row in enumerate(rows)]
    path.write_text("\n".join([f"name,{columns}", *lines]) + "\n")
    return path


def flange_poses(rng: np.random.Generator, count: int, turn: float = 1.0) -> tuple[np.ndarray, Rotation]:
    return rng.uniform(-300.0, 300.0, (count, 3)), Rotation.from_rotvec(turn * rng.uniform(-1.0, 1.0, (count, 3)))


def test_points_tell_tool_base_and_bad_rows_a_third_of_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    xyz, turn = flange_poses(rng, 21)
    points = INSTRUMENT.apply(xyz + turn.apply(TOOL)) + rng.normal(0.0, 0.05, (21, 3)) + BASE
    points[::3] += rng.normal(0.0, 40.0, (7, 3))
    flange = table(tmp_path / "kuka.csv", "P", "x,y,z,a,b,c", np.hstack([xyz, turn.as_euler("ZYX", degrees=True)]))
    measured = table(tmp_path / "points.csv", "P", "x,y,z", points)
    text = printed("import", tmp_path / "cell", "--flange-poses", flange, "--points", measured)
    assert "turns about z, y', x''" in text
    found = answered("calibrate", tmp_path / "cell")
    assert {row["pose"] for row in found["bad_rows"]} == {f"P{k}" for k in range(0, 21, 3)}
    off = (np.array(found["tool_point_mm"]) - TOOL) / found["tool_point_sigma_mm"]
    assert np.abs(off).max() < 4.0
    assert max(found["tool_point_sigma_mm"]) < 0.1
    place = (np.array(found["base_frame"]["xyz_mm"]) - BASE) / found["base_frame"]["sigma_mm"]
    assert np.abs(place).max() < 4.0


@pytest.mark.parametrize("turn", [1.0, 0.02])
def test_one_tip_visited_gives_the_tool_by_pivoting_and_what_is_open(tmp_path: Path, turn: float) -> None:
    rng = np.random.default_rng(5)
    _, attitude = flange_poses(rng, 8, turn)
    xyz = np.array([400.0, 50.0, 300.0]) - attitude.apply(TOOL) + rng.normal(0.0, 0.3, (8, 3))
    rows = np.hstack([xyz, attitude.as_rotvec()])
    flange = table(tmp_path / "tcp.csv", "", "x_mm,y_mm,z_mm,rvec_x,rvec_y,rvec_z", rows)
    document = answered("import", tmp_path / "cell", "--flange-poses", flange)
    hardly_turns = [line for line in document["doubts"] if "the poses hardly turn" in line]
    assert bool(hardly_turns) == (turn < 0.1)
    found = answered("calibrate", tmp_path / "cell")
    assert np.abs((np.array(found["tool_point_mm"]) - TOOL) / found["tool_point_sigma_mm"]).max() < 4.0
    assert (max(found["tool_point_sigma_mm"]) > 5.0) == (turn < 0.1)
    assert found["base_frame"] is None


def test_a_flange_that_never_moved_is_told_first(tmp_path: Path) -> None:
    rows = np.tile([0.3, 0.1, 0.5, 2.5, 0.1, 1.7], (6, 1))
    flange = table(tmp_path / "samples.csv", "s", "x,y,z,r1,r2,r3", rows)
    assert "the flange stands at one pose in all 6 rows" in refused("import", tmp_path / "a", "--flange-poses", flange)


def test_what_drives_do_is_told_without_points_and_what_would_tell_laws_apart(tmp_path: Path) -> None:
    read = np.array([18.0, 27.0, 36.0, 47.0, 56.0])
    noise = np.array([-0.9, 0.3, 0.9, -0.8, 0.4])
    droop = np.column_stack([read + 40.0 * np.sin(np.radians(read)) + noise, read])
    path = table(tmp_path / "joint1.csv", "", "target_joint1_deg,actual_joint1_deg", droop)
    (line,) = drives_in_words(load_table(path))
    assert "a spring against gravity" in line
    assert "5 poses do not tell them apart; one that reads -180 deg would" in line
    robots = (RobotReading("", RobotFile(builtin_robot("rb5"), None)),)
    assert "actual_joint1_deg is" in plan_import(ImportSources(robots, path)).faults[-1]
    far = np.array([-170.0, -90.0, 20.0, 80.0, 150.0])
    path = table(tmp_path / "far.csv", "", "q1_cmd_deg,q1_actual_deg", np.column_stack([far - 3.0, far]))
    (line,) = drives_in_words(load_table(path))
    assert "a zero that is off by 3 deg" in line
    assert "do not tell" not in line
