"""Spreadsheets, written by another library, and JSON records as tables: titles, several sheets, lists of joints."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from calib.dataset.dataset import Dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.dataset_import.archive import is_archive
from calib.dataset_import.columns import recognise
from calib.dataset_import.user_files import BOTH, JOINTS, POINTS, UNUSED, look_through
from calib.errors import DatasetError
from calib.simulation.simulate import simulate_dataset
from calib.text_files.user_table import load_table
from tests.support.commands import printed
from tests.support.imported import import_dataset

ROBOT = builtin_robot("rb5")
JOINT_NAMES = [f"Achse {k} [°]" for k in range(1, 7)]


@pytest.fixture(scope="module")
def truth() -> Dataset:
    return simulate_dataset(ROBOT, rng=0, poses=32, noise_mm=0.02).dataset


def numbers(dataset: Dataset) -> np.ndarray:
    """Joints in degrees and points in millimetres, a row a pose."""
    return np.hstack([np.degrees(dataset.poses.q), dataset.points.xyz_mm])


def is_same(made: Dataset, truth: Dataset) -> bool:
    return np.allclose(made.poses.q, truth.poses.q, atol=1e-9) and np.allclose(made.points.xyz_mm, truth.points.xyz_mm)


def book(path: Path, **named: list[list[object]]) -> Path:
    """A workbook with these sheets."""
    made = openpyxl.Workbook()
    made.remove(made.active)
    for name, rows in named.items():
        sheet = made.create_sheet(name)
        for row in rows:
            sheet.append(row)
    made.save(path)
    return path


def test_a_sheet_below_its_titles_is_imported(truth: Dataset, tmp_path: Path) -> None:
    rows: list[list[object]] = [["Messprotokoll", "RB5"], [], ["Punkt", *JOINT_NAMES, "X [mm]", "Y [mm]", "Z [mm]"]]
    rows += [[f"P{i:03}", *row] for i, row in enumerate(numbers(truth).tolist())]
    path = book(tmp_path / "protokoll.xlsx", Deckblatt=[["nothing here"]], Werte=rows)
    made = import_dataset(tmp_path / "made", ROBOT, path).dataset
    assert is_same(made, truth)
    assert made.poses.ids[3] == "P003"
    assert not is_archive(path)


def test_joints_and_points_of_two_sheets_are_found_and_named(truth: Dataset, tmp_path: Path) -> None:
    values = numbers(truth).tolist()
    ids = [f"P{i}" for i in range(len(values))]
    joints = [["pose", *JOINT_NAMES], *([name, *row[:6]] for name, row in zip(ids, values, strict=True))]
    points = [["pose", "x_mm", "y_mm", "z_mm"], *([n, *row[6:]] for n, row in zip(ids, values, strict=True))]
    path = book(tmp_path / "all.xlsx", Joints=joints, Tracker=points)
    found = look_through(tmp_path)
    assert {file.path.name: file.kind for file in found.files} == {
        "all.xlsx#Joints": JOINTS,
        "all.xlsx#Tracker": POINTS,
    }
    assert found.joints is not None
    made = import_dataset(tmp_path / "made", ROBOT, found.joints, found.points).dataset
    assert is_same(made, truth)
    with pytest.raises(DatasetError, match=r"no sheet 'None'; there are 'Joints', 'Tracker'"):
        load_table(path.with_name("all.xlsx#None"))


@pytest.mark.parametrize("point", ["list", "object", "lines"])
def test_json_records_with_lists_of_joints_are_imported(point: str, truth: Dataset, tmp_path: Path) -> None:
    records = [
        {
            "name": f"P{i}",
            "joints": row[:6],
            "point": dict(zip("xyz", row[6:], strict=True)) if point == "object" else row[6:],
        }
        for i, row in enumerate(numbers(truth).tolist())
    ]
    path = tmp_path / ("poses.jsonl" if point == "lines" else "poses.json")
    lines = "\n".join(map(json.dumps, records))
    path.write_text(lines if point == "lines" else json.dumps({"robot": "arm", "poses": records}))
    assert [file.kind for file in look_through(tmp_path).files] == [BOTH]
    printed("import", tmp_path / "made", "--robot", "rb5", "--joints", path)
    assert is_same(import_dataset(tmp_path / "again", ROBOT, path).dataset, truth)


def test_a_bad_cell_is_named_by_its_row_in_the_sheet(truth: Dataset, tmp_path: Path) -> None:
    rows: list[list[object]] = [["title"], [*JOINT_NAMES, "x_mm", "y_mm", "z_mm"], *numbers(truth).tolist()]
    rows[5][2] = "n/a"
    path = book(tmp_path / "bad.xlsx", Sheet1=rows)
    with pytest.raises(DatasetError, match=r"line 6, column Achse 3 \[°\]: found 'n/a'"):
        import_dataset(tmp_path / "made", ROBOT, path)


def test_a_bad_value_of_a_file_a_pose_is_told_with_the_files_name(truth: Dataset, tmp_path: Path) -> None:
    for i, row in enumerate(numbers(truth).tolist()):
        record = {"q_deg": ["n/a" if i == 2 else row[0], *row[1:6]], "point_mm": row[6:]}
        (tmp_path / f"shot_{i:02}.json").write_text(json.dumps(record))
    with pytest.raises(DatasetError, match=r"\*\.json: shot_02\.json, file 3, column q1 \[deg\]: found 'n/a'"):
        import_dataset(tmp_path / "made", ROBOT, tmp_path / "*.json")


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.xlsx", b"PK\x03\x04 no workbook", "cannot be read as a spreadsheet"),
        ("a.ods", b"", "cannot be read as a spreadsheet"),
        ("a.json", b"[1, 2", "cannot be read as JSON"),
        ("a.json", b'{"a": 1}', "holds no list of records"),
        ("a.json", b"[" * 5000, "cannot be read as JSON"),
        ("a.json", b'[{"q1": ' + b"9" * 5000 + b"}]", "cannot be read as JSON"),
    ],
)
def test_what_is_no_table_is_one_line_and_not_used(name: str, content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=says):
        load_table(path)
    assert [file.kind for file in look_through(tmp_path).files] == [UNUSED]


def test_two_cells_at_the_ends_of_a_sheet_end_its_reader_alone(tmp_path: Path) -> None:
    made = openpyxl.Workbook()
    made.active["A1"] = made.active["XFD1048576"] = 1
    made.save(tmp_path / "far.xlsx")
    with pytest.raises(DatasetError, match=r"far\.xlsx: cannot be read as a spreadsheet \(it ended its reader"):
        load_table(tmp_path / "far.xlsx")


def test_columns_of_a_plotted_log_are_the_joints_of_their_name() -> None:
    named = (
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    )
    joints = tuple(replace(joint, name=name) for joint, name in zip(ROBOT.joints, named, strict=True))
    robot = replace(ROBOT, joints=joints)
    names = [f"/joint_states/{joint.name}/{what}" for joint in robot.joints for what in ("position", "velocity")]
    meant = recognise(names, robot, {})
    assert [meant.columns[f"q{k + 1}"].name for k in range(6)] == names[::2]
