"""Import with rows that cannot be read, with a sigma and with a tool offset, and the preview of what comes out."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset_import.import_dataset import write_plan
from calib.dataset_import.plan import ImportPlan, ImportSources, plan_import
from calib.dataset_import.questions import with_tool_offset
from calib.dataset_import.typed_values import typed_length_mm, typed_point_mm
from calib.kinematics.chain import target_points
from calib.kinematics.tool_point import tool_point_of
from calib.present.fit.dataset import first_rows, preview
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.chain.serial_chain import chain_frames
from calib.robot_formats.conventions import RobotReading
from calib.robot_formats.robot_file import RobotFile, read_robot
from calib.robot_formats.urdf.text import plain_urdf
from calib.simulation.simulate import simulate_dataset

ROBOT = builtin_robot("rb5")
ASKED = (RobotReading("", RobotFile(ROBOT, None)),)
COUNT = 20
UNMEASURED = (13, 16)
BAD_JOINTS = {3: "n/a", 7: "nan"}  # a cell of a row of joints
BAD_POINT = 10


@pytest.fixture(scope="module")
def truth() -> Dataset:
    return simulate_dataset(ROBOT, rng=5, poses=COUNT, noise_mm=0.02).dataset


def tables(folder: Path, truth: Dataset, *, named: bool = True, bad: bool = True) -> tuple[Path, Path]:
    """Tables of joints and of points; without names of poses the rows of both belong together by their order."""
    joints = [[f"{value:.9f}" for value in row] for row in truth.poses.q]
    points = [[f"{value:.6f}" for value in row] for row in truth.points.xyz_mm]
    ids = [[f"P{i:02d}"] if named else [] for i in range(COUNT)]
    if bad:
        for i, cell in BAD_JOINTS.items():
            joints[i][2] = cell
        points[BAD_POINT].append("7.5")
    lines = [",".join([*(["pose"] if named else []), *(f"q{k}_rad" for k in range(1, 7))])]
    lines += [",".join([*ids[i], *row]) for i, row in enumerate(joints)]
    (folder / "joints.csv").write_text("\n".join(lines))
    kept = [i for i in range(COUNT) if not named or i not in UNMEASURED]
    lines = [",".join([*(["pose"] if named else []), "x_mm", "y_mm", "z_mm"])]
    lines += [",".join([*ids[i], *points[i]]) for i in kept]
    (folder / "points.csv").write_text("\n".join(lines))
    return folder / "joints.csv", folder / "points.csv"


def planned(joints: Path, points: Path, *, skip: bool = False) -> ImportPlan:
    return plan_import(ImportSources(ASKED, joints, points, skip_bad_rows=skip))


def test_bad_rows_are_faults_that_can_be_left_out(truth: Dataset, tmp_path: Path) -> None:
    plan = planned(*tables(tmp_path, truth))
    assert plan.preview is None
    assert {(row.path.name, row.line, row.column) for row in plan.bad_rows} == {
        ("joints.csv", 5, "q3_rad"), ("joints.csv", 9, "q3_rad"), ("points.csv", 12, ""),
    }  # fmt: skip
    assert len(plan.faults) == len(plan.bad_rows)
    assert (plan.can_leave_out, plan.are_left_out) == (True, False)


def test_the_rest_comes_out_and_the_notes_of_import_and_dataset_name_the_rows(truth: Dataset, tmp_path: Path) -> None:
    plan = planned(*tables(tmp_path, truth), skip=True)
    assert plan.faults == ()
    assert plan.are_left_out
    made = write_plan(plan, tmp_path / "cell")
    gone = [3, 7]
    assert made.poses.ids == tuple(f"P{i:02d}" for i in range(COUNT) if i not in gone)
    assert made.poses.q == pytest.approx(np.delete(truth.poses.q, gone, axis=0), abs=1e-8)
    assert made.points is not None
    assert len(made.points) == COUNT - len({*gone, *UNMEASURED, BAD_POINT})
    for part in (
        "joints.csv: 2 of 20 rows", "line 5, column q3_rad (found 'n/a')", "line 9", "points.csv: 1 of 18 rows",
        "line 12 (found 5 cells", "points.csv: rows of these poses are left out, too",
    ):  # fmt: skip
        for notes in (plan.notes, made.notes, load_dataset(tmp_path / "cell").notes):
            assert any(part in note for note in notes), part
    written = tomllib.loads((tmp_path / "cell" / "dataset.toml").read_text())["notes"]
    assert not any(str(tmp_path) in note for note in written)
    write_dataset(made, tmp_path / "again")
    assert load_dataset(tmp_path / "again").notes[:3] == made.notes[:3]


def test_rows_that_belong_together_by_their_order_are_left_out_together(truth: Dataset, tmp_path: Path) -> None:
    plan = planned(*tables(tmp_path, truth, named=False), skip=True)
    made = write_plan(plan, tmp_path / "cell")
    kept = [i for i in range(COUNT) if i not in (*BAD_JOINTS, BAD_POINT)]
    assert made.poses.ids == tuple(f"p{i + 1}" for i in kept)  # as the rows of the file are counted
    assert made.points.xyz_mm == pytest.approx(truth.points.xyz_mm[kept], abs=1e-5)


def test_more_than_half_of_the_rows_are_never_left_out(truth: Dataset, tmp_path: Path) -> None:
    joints, points = tables(tmp_path, truth, bad=False)
    header, *rows = joints.read_text().splitlines()
    for count, fine in ((COUNT // 2, True), (COUNT // 2 + 1, False)):
        joints.write_text("\n".join([header, *(f"{row}x" for row in rows[:count]), *rows[count:]]))
        plan = planned(joints, points, skip=True)
        assert (plan.are_left_out, plan.can_leave_out, plan.faults == ()) == (fine, False, fine)
    assert "11 of 20 rows cannot be read" in plan.faults[0]


def test_the_preview_is_of_the_dataset_that_is_written(truth: Dataset, tmp_path: Path) -> None:
    plan = planned(*tables(tmp_path, truth, bad=False))
    assert plan.bad_rows == ()
    assert plan.preview is not None
    assert preview(plan.preview) == "20 poses, 18 points; P13 and P16 have no point."
    table = first_rows(plan.preview)
    assert list(table.headers) == ["pose", "role", *(f"q{k} deg" for k in range(1, 7)), "x mm", "y mm", "z mm"]
    assert [float(cell) for cell in table.rows[0][2:8]] == pytest.approx(np.degrees(truth.poses.q[0]), abs=1e-3)
    assert [float(cell) for cell in table.rows[0][8:]] == pytest.approx(truth.points.xyz_mm[0], abs=1e-3)


def test_sigma_and_tool_offset_are_written(truth: Dataset, tmp_path: Path) -> None:
    joints, points = tables(tmp_path, truth, bad=False)
    plan = plan_import(ImportSources(ASKED, joints, points, point_sigma_mm=0.03, tool_mm=(10.0, -5.0, -120.0)))
    made = write_plan(plan, tmp_path / "cell")
    assert made.scanner.point_sigma_mm == 0.03
    assert tool_point_of(made.robot) == pytest.approx([10.0, -5.0, -120.0])
    beyond = plan_import(ImportSources(ASKED, joints, points, point_sigma_mm=1e6))
    assert any("point_sigma_mm" in fault for fault in beyond.faults)


def test_an_offset_is_from_the_end_of_the_robots_file(tmp_path: Path) -> None:
    """Of a URDF from its last link, whose place in robot.toml stays; of a robot.toml from its last joint."""
    (tmp_path / "arm.urdf").write_text(plain_urdf(chain_of(ROBOT)))
    file = read_robot(tmp_path / "arm.urdf")
    assert file.chain is not None
    offset_mm = (12.0, -7.0, 55.0)
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (5, 6))
    moved = with_tool_offset(file, offset_mm).robot
    expected = chain_frames(file.chain, q)[:, -1] @ [*offset_mm, 1.0]
    assert target_points(moved, q) == pytest.approx(expected[:, :3], abs=1e-9)
    assert moved.table == pytest.approx(file.robot.table)
    own = with_tool_offset(RobotFile(ROBOT, None), offset_mm).robot
    assert own.targets == ()
    assert tool_point_of(own) == pytest.approx(offset_mm)


@pytest.mark.parametrize(("text", "value"), [("0.05", 0.05), (" 0,05 mm", 0.05), ("5e-2", 0.05)])
def test_a_typed_length(text: str, value: float) -> None:
    assert typed_length_mm(text) == value


@pytest.mark.parametrize("text", ["", "0", "-1", "nan", "inf", "1_0", "a", "1 2"])
def test_what_is_no_length(text: str) -> None:
    with pytest.raises(ValueError, match="is no standard deviation"):
        typed_length_mm(text)


@pytest.mark.parametrize("text", ["1,2,3", "1, 2, 3 mm", "1 2 3", "1;2;3"])
def test_a_typed_point(text: str) -> None:
    assert typed_point_mm(text) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "a,b,c", "1,2,inf", "1_0,2,3"])
def test_what_is_no_point(text: str) -> None:
    with pytest.raises(ValueError, match="is no point"):
        typed_point_mm(text)
