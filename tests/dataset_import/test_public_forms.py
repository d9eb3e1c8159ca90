"""Tables in the layouts that public recordings have, with values of an arm whose truth is another code's."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from calib.text_files.user_table import parse_table
from inspector.cli.parser import main
from tests.support.commands import refused
from tests.support.public_forms import DEG, NOMINAL, POINTS, Array, Cells, Form, J, Q, require_import, text
from tests.support.recorded_run import NAMES, robot_toml


def one(head: Sequence[str], columns: Sequence[Array | Sequence[str]], name: str = "t.csv", **options: str) -> Form:
    return lambda folder: ["--joints", text(folder / name, head, columns, **options)]


def beside(
    head: Sequence[str], columns: Sequence[Array | Sequence[str]], name: str = "points.csv", **options: str
) -> Form:
    """Points beside a table of named poses."""

    def write(folder: Path) -> list[str]:
        joints = text(folder / "joints.csv", [",".join(["Name", *J])], [IDS, *DEG.T])
        return ["--joints", joints, "--points", text(folder / name, head, columns, **options)]

    return write


def book(**sheets: Cells) -> Form:
    def write(folder: Path) -> list[str]:
        made = openpyxl.Workbook()
        made.remove(made.active)
        for name, rows in sheets.items():
            sheet = made.create_sheet(name)
            for row in rows:
                sheet.append([float(cell) if isinstance(cell, float) else cell for cell in row])
        made.save(folder / "book.xlsx")
        return ["--joints", str(folder / "book.xlsx")]

    return write


def records(content: object) -> Form:
    def write(folder: Path) -> list[str]:
        (folder / "cal.json").write_text(json.dumps(content))
        return ["--joints", str(folder / "cal.json")]

    return write


def a_file_each(folder: Path) -> list[str]:
    for k, (q, point) in enumerate(zip(Q.tolist(), POINTS.tolist(), strict=True)):
        (folder / f"pose_{k:03}.json").write_text(json.dumps({"joint_positions": q, "point_mm": point}))
    return ["--joints", str(folder / "*.json")]


def program(folder: Path) -> list[str]:
    axes = [", ".join(f"A{k + 1} {value:.6f}" for k, value in enumerate(q)) for q in DEG]
    lines = [f"DECL E6AXIS XP{k}={{{each},E1 0.0}}" for k, each in enumerate(axes, 1)]
    (folder / "run.dat").write_text("\n".join(["DEFDAT RUN", *lines, "ENDDAT"]))
    return ["--joints", str(folder / "run.dat"), "--points", text(folder / "p.csv", ["Name,X,Y,Z"], [IDS, *POINTS.T])]


def yaml_records(folder: Path) -> list[str]:
    pairs = zip(Q.tolist(), POINTS.tolist(), strict=True)
    (folder / "cal.yaml").write_text("\n".join(f"- {{joints: {q}, position: {p}}}" for q, p in pairs))
    return ["--joints", str(folder / "cal.yaml")]


DISTANCE = np.linalg.norm(POINTS, axis=1)
ZENITH, EAST_TO_NORTH = np.arccos(POINTS[:, 2] / DISTANCE), np.arctan2(POINTS[:, 1], POINTS[:, 0])
IDS = [f"P{k}" for k in range(1, 37)]
BOTH = [*DEG.T, *POINTS.T]
LIST = "[{}]".format
TURNED = [[None, *map(float, row)] for row in np.column_stack(BOTH)]

POSES: dict[str, Form] = {
    # header of the calibration tables of figaroh: markers x1 ..., joints by name
    "figaroh": one(
        [",".join([*(f"{a}{k}" for k in (1, 2) for a in "xyz"), *NAMES])], [*POINTS.T / 1e3, *NOMINAL.T / 1e3, *Q.T]
    ),
    "figaroh, comma behind": one(
        [",".join(["x1", "y1", "z1", "phix1", *NAMES, ""])], [*POINTS.T / 1e3, Q[:, 0], *Q.T, [""] * 36]
    ),
    "laser tracker of Leica": beside(
        ["X  [mm],Y  [mm],Z  [mm],U(95)  [mm],U(95) X  [mm],Q0 ,Q1 ,Q2 ,Q3 ,Image RMS  [µm],Target,Time Stamp"],
        [
            *POINTS.T,
            *np.full((7, 36), 0.2),
            ["TMC 30-B #5320"] * 36,
            [f"'11.10.2022 15:06:{k}.043" for k in range(10, 46)],
        ],
        encoding="cp1252",
    ),
    "tracker, nominal first, Chinese": beside(
        ["名称,名义 X,名义 Y,名义 Z,测量 X,测量 Y,测量 Z"], [IDS, *NOMINAL.T, *POINTS.T]
    ),
    "coordinate measuring machine": beside(
        ["Name,X nominal,X measured,X deviation,Y nominal,Y measured,Y deviation,Z nominal,Z measured,Z deviation"],
        [IDS, *(c for k in range(3) for c in (NOMINAL[:, k], POINTS[:, k], POINTS[:, k] - NOMINAL[:, k]))],
    ),
    "SpatialAnalyzer, words": beside(
        ["// SpatialAnalyzer 2023.1", "// Frame: A::WORLD"],
        [["A"] * 36, ["Tracker"] * 36, IDS, *POINTS.T],
        "p.txt",
        sep=" ",
    ),
    "SpatialAnalyzer, commented names": beside(
        ["// Collection, Group, Target, X, Y, Z"], [["A"] * 36, ["T"] * 36, IDS, *POINTS.T], sep=", "
    ),
    "names and points alone": beside([], [IDS, *POINTS.T], "p.txt", sep=" "),
    "points before joints, no names": one([], [*POINTS.T, *DEG.T]),
    "numpy.savetxt": one(
        ["# " + " ".join([*(f"q{k}" for k in range(6)), *"xyz"])], [*Q.T, *POINTS.T], "t.txt", sep=" ", number="{:.18e}"
    ),
    "German record": one(
        [
            "Messprotokoll;;;;;;;;;",
            "Datum: 05.03.2024;;;;;;;;;",
            ";;;;;;;;;",
            "Punkt;A1;A2;A3;A4;A5;A6;X;Y;Z",
            ";°;°;°;°;°;°;mm;mm;mm",
        ],
        [IDS, *([f"{v:,.4f}".translate({44: ".", 46: ","}) for v in column] for column in BOTH)],
        sep=";",
        encoding="cp1252",
    ),
    "French record": one(
        ["N°;" + ";".join(f"Axe {k} (°)" for k in range(1, 7)) + ";X (mm);Y (mm);Z (mm)"],
        [IDS, *([f"{v:,.4f}".translate({44: "\u202f", 46: ","}) for v in column] for column in BOTH)],
        sep=";",
    ),
    "American thousands": one(
        [",".join(["Point ID", *J, "X", "Y", "Z"])], [IDS, *([f'"{v:,.4f}"' for v in column] for column in BOTH)]
    ),
    "decimal commas and spaces": one([], BOTH, "t.txt", sep=" ", decimal=","),
    "sep= of Excel": one(["sep=;", ";".join([*J, *"XYZ"])], BOTH, sep=";", decimal=","),
    "sheet with merged cells": book(
        Report=[
            ["Calibration of cell 3"],
            [],
            ["Pose", "Joint angles", *[None] * 5, "Measured point", None, None],
            [None, *J, "X", "Y", "Z"],
            [None, *["deg"] * 6, *["mm"] * 3],
            *([name, *row[1:]] for name, row in zip(IDS, TURNED, strict=True)),
        ]
    ),
    "lists in cells": one(
        ["pose,joints,point"],
        [IDS, [f'"{LIST(", ".join(map(str, q)))}"' for q in Q], [f'"{LIST(" ".join(map(str, p)))}"' for p in POINTS]],
    ),
    "JSON of lists": records({"joint_angles": Q.tolist(), "positions": (POINTS / 1e3).tolist()}),
    "JSON of columns": records(
        {**{f"q{k + 1}": Q[:, k].tolist() for k in range(6)}, **{a: POINTS[:, k].tolist() for k, a in enumerate("xyz")}}
    ),
    "readings of a pose in rows": one(
        [",".join(["Pose", *J, "Reading", "X", "Y", "Z"])],
        [np.repeat(IDS, 2).tolist(), *np.repeat(DEG, 2, 0).T, [*"12"] * 36, *np.repeat(POINTS, 2, 0).T],
    ),
    "limits above and below the names": one(
        [f"min{',-200' * 9}", ",".join(["Pose", *J, "X", "Y", "Z"]), f"max{',2000' * 9}"], [IDS, *BOTH]
    ),
    "running numbers beside names": beside(
        ["No,Point,X,Y,Z"], [[str(k) for k in range(1, 37)], [f"Cell::{i}" for i in IDS[::-1]], *POINTS[::-1].T]
    ),
    "nested JSON": records(
        {
            "run": [
                {"id": i, "robot": {"joints_deg": list(q)}, "tracker": {"position": dict(zip("xyz", p, strict=True))}}
                for i, q, p in zip(IDS, DEG.tolist(), POINTS.tolist(), strict=True)
            ]
        }
    ),
    "a JSON file a pose": a_file_each,
    "YAML records": yaml_records,
    "a data list of KUKA": program,
    "total station, from north, gon": beside(
        ["Name,Hz [gon],V [gon],Distance [m]"],
        [IDS, (np.pi / 2 - EAST_TO_NORTH) % (2 * np.pi) * 200 / np.pi, ZENITH * 200 / np.pi, DISTANCE / 1e3],
        number="{:.9f}",
    ),
    "tracker, azimuth and elevation": one(
        [",".join([*J, "Azimuth", "Elevation", "Distance"])],
        [*DEG.T, EAST_TO_NORTH, np.pi / 2 - ZENITH, DISTANCE],
        number="{:.9f}",
    ),
    "Universal Robots by name": one(
        ["Base [deg],Shoulder [deg],Elbow [deg],Wrist 1 [deg],Wrist 2 [deg],Wrist 3 [deg],x,y,z"], BOTH
    ),
    "positions, speeds, efforts": one(
        [",".join([*(f"joint{k}_{w}" for w in ("pos", "vel", "eff") for k in range(6)), *"xyz"])],
        [*Q.T, *Q.T * 0, *Q.T, *POINTS.T],
    ),
}


USUAL = (
    "figaroh",
    "laser tracker of Leica",
    "German record",
    "sheet with merged cells",
    "YAML records",
    "a data list of KUKA",
    "total station, from north, gon",
    "tracker, azimuth and elevation",
)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in USUAL else pytest.mark.thorough) for n in POSES])
def test_public_forms_are_imported_without_a_mapping(name: str, tmp_path: Path) -> None:
    require_import(POSES[name], tmp_path)


REFUSED = {
    "angles that the arm does not tell": (
        one([",".join([*J, "Azimuth", "Elevation", "Distance"])], [*DEG.T, *np.zeros((2, 36)), DISTANCE]),
        "may be meant in several ways",
    ),
    "no names": (one([], [*POINTS.T, *NOMINAL.T, *DEG.T]), "write a line of names above them"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_told_is_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    make, says = REFUSED[name]
    (tmp_path / "robot.toml").write_text(robot_toml())
    out = tmp_path / "cell"
    assert re.search(says, refused("import", out, "--robot", tmp_path / "robot.toml", *make(tmp_path)))
    assert not out.exists()


def test_bad_first_rows_are_rows_and_no_titles() -> None:
    faults: list[object] = []
    table = parse_table(Path("t.csv"), "pose,q1,x\nP1,n/a,n/a\nP2,n/a,n/a\nP3,1.5,2.5\nP4,2.5,3.5\n", faults.append)
    assert table.columns == ("pose", "q1", "x")
    assert table.text("pose") == ["P1", "P2", "P3", "P4"]


def test_the_controllers_own_pose_beside_the_joints_is_doubted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.toml").write_text(robot_toml())
    form = one([",".join([*J, "x", "y", "z", "rx", "ry", "rz"])], [*DEG.T, *NOMINAL.T, *Q.T[:3]])
    assert main(["import", str(tmp_path / "cell"), "--robot", str(tmp_path / "robot.toml"), *form(tmp_path)]) == 0
    assert "the pose that the controller computes" in capsys.readouterr().err
