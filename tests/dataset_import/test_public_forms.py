"""Tables and logs in the layouts that public recordings have, with values of an arm whose truth is another code's."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from calib.calibration.calibrate import calibrate
from calib.dataset.files.folder import load_dataset
from calib.frames import apply, best_fit_transform
from calib.kinematics.chain import target_points
from calib.text_files.user_table import parse_table
from inspector.cli.parser import main
from tests.support.recorded_run import NAMES, robot_toml, tool_mm

Array = np.ndarray
LOW, HIGH = np.array([-2.5, -2.2, -2.2, -2.5, -2.0, -2.5]), np.array([2.5, -0.4, 2.2, 0.5, 2.0, 2.5])
Q = np.random.default_rng(3).uniform(LOW, HIGH, (36, 6))
POINTS = tool_mm(Q) + np.random.default_rng(4).normal(0.0, 0.03, (36, 3))
NOMINAL = tool_mm(Q, (0.0,) * 6)
DEG = np.degrees(Q)
J = [f"J{k}" for k in range(1, 7)]
Cells = Sequence[Sequence[object]]
Form = Callable[[Path], list[str]]


def text(
    path: Path, head: Sequence[str], columns: Sequence[Array | Sequence[str]], sep: str = ",", number: str = "{:.6f}",
    encoding: str = "utf-8", decimal: str = ".",
) -> str:  # fmt: skip
    """File of lines of a head and of columns of numbers or words."""
    lists = [[*each] for each in columns]
    rows = [
        [c if isinstance(c, str) else number.format(c).replace(".", decimal) for c in row]
        for row in zip(*lists, strict=True)
    ]
    path.write_text("\n".join([*head, *(sep.join(row) for row in rows)]) + "\n", encoding=encoding)
    return str(path)


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
    "sheets of joints and points": book(
        Info=[["Project", "a", "b"], ["Robot", "c", "d"]],
        Joints=[["No", *J], *([k, *row[1:7]] for k, row in enumerate(TURNED))],
        Tracker=[["No", "X", "Y", "Z"], *([k, *row[7:]] for k, row in enumerate(TURNED))],
    ),
    "lists in cells": one(
        ["pose,joints,point"],
        [IDS, [f'"{LIST(", ".join(map(str, q)))}"' for q in Q], [f'"{LIST(" ".join(map(str, p)))}"' for p in POINTS]],
    ),
    "JSON of lists": records({"joint_angles": Q.tolist(), "positions": (POINTS / 1e3).tolist()}),
    "JSON of columns": records(
        {**{f"q{k + 1}": Q[:, k].tolist() for k in range(6)}, **{a: POINTS[:, k].tolist() for k, a in enumerate("xyz")}}
    ),
    "Universal Robots by name": one(
        ["Base [deg],Shoulder [deg],Elbow [deg],Wrist 1 [deg],Wrist 2 [deg],Wrist 3 [deg],x,y,z"], BOTH
    ),
    "positions, speeds, efforts": one(
        [",".join([*(f"joint{k}_{w}" for w in ("pos", "vel", "eff") for k in range(6)), *"xyz"])],
        [*Q.T, *Q.T * 0, *Q.T, *POINTS.T],
    ),
}


def stop_and_go() -> tuple[Array, Array]:
    """Times (N,), s, and joints (N, 6): 1.2 s at each pose, 0.8 s on the way to the next."""
    t = np.arange(0.0, 2.0 * len(Q) - 0.8, 0.02)
    k = (t / 2.0).astype(int)
    share = np.clip((t - 2.0 * k - 1.2) / 0.8, 0.0, 1.0)[:, None]
    q = Q[k] + (3.0 * share**2 - 2.0 * share**3) * (Q[np.minimum(k + 1, len(Q) - 1)] - Q[k])
    return t, q


T, MOVING = stop_and_go()
SEEN = tool_mm(MOVING) + np.random.default_rng(1).normal(0.0, 0.03, MOVING[:, :3].shape)
WALL = np.array([900.0, 1500.0, 300.0]) + np.random.default_rng(2).normal(0.0, 0.03, SEEN.shape)
MOVING = MOVING + np.random.default_rng(0).normal(0.0, 1e-5, MOVING.shape)
OTHER = 10.0 * np.sin(np.arange(MOVING.size)).reshape(MOVING.shape)  # currents, torques
FRAMES = [str(k) for k in range(1, len(T) + 1)]
MS = [f"{1000 * t:.0f}" for t in T]


def log(head: Sequence[str], columns: Sequence[Array | Sequence[str]], **options: str) -> Form:
    """A controller's log beside a tracker's."""

    def write(folder: Path) -> list[str]:
        joints = text(folder / "log.csv", head, columns, **options)
        return ["--joints", joints, "--points", text(folder / "tracker.csv", ["time_s,x_mm,y_mm,z_mm"], [T, *SEEN.T])]

    return write


def capture(head: Sequence[str], columns: Sequence[Array | Sequence[str]], sep: str = ",") -> Form:
    """Motion capture beside a log of joints."""

    def write(folder: Path) -> list[str]:
        joints = text(folder / "log.csv", ["t," + ",".join(NAMES)], [T, *MOVING.T])
        return ["--joints", joints, "--points", text(folder / "capture.tsv", head, columns, sep=sep)]

    return write


def names(*stems: str, first: int = 0) -> str:
    return ",".join(stem.format(k) for stem in stems for k in range(first, first + 6))


QUALISYS = [f"NO_OF_FRAMES\t{len(T)}", "FREQUENCY\t50", "TIME_STAMP\t2024-03-05, 10:11:12\t1.5", "DATA_INCLUDED\t3D"]
LOGS: dict[str, Form] = {
    "RTDE": log(
        ["timestamp " + names("actual_q_{}", "actual_qd_{}").replace(",", " ")], [T, *MOVING.T, *OTHER.T], sep=" "
    ),
    "measured and external torques": log(
        ["timestamp," + names("actual_q_{}", "target_q_{}", "measured_tq_{}")], [T, *MOVING.T, *MOVING.T, *OTHER.T]
    ),
    "libfranka": log(
        ["time, success_rate, " + names("state.q[{}]", "state.q_d[{}]", "state.dq[{}]", "state.tau_J[{}]")],
        [MS, T * 0, *MOVING.T, *MOVING.T, *OTHER.T, *OTHER.T],
    ),
    "franka-interface": log(
        ["time_since_skill_started," + names("q_{}", "q_d_{}", "dq_{}")], [T, *MOVING.T, *MOVING.T, *OTHER.T]
    ),
    "KUKA FRI": log(
        ["index,time,tsec,tnsec," + names("mp{}", "ip{}", "mt{}", "et{}", first=1)],
        [FRAMES, T, FRAMES, FRAMES, *MOVING.T, *MOVING.T, *OTHER.T, *OTHER.T],
    ),
    "KUKA RSI": log(
        ["IPOC," + names("AIPos.A{}", "ASPos.A{}", "MACur.A{}", first=1)],
        [[f"{435413237 + int(m)}" for m in MS], *np.degrees(MOVING).T, *np.degrees(MOVING).T, *OTHER.T],
    ),
    "KUKA trace": log(
        [
            "Zeit [s];"
            + names("Istposition Achse {} [°]", "Sollposition Achse {} [°]", "Strom Achse {} [A]", first=1).replace(
                ",", ";"
            )
        ],
        [T, *np.degrees(MOVING).T, *np.degrees(MOVING).T, *OTHER.T],
        sep=";",
        decimal=",",
        encoding="cp1252",
    ),
    "ABB, two arms": log(
        ["timestamp,cmdnum," + names("J{}", "J{}_2", first=1)],
        [T, T * 0, *np.degrees(MOVING).T, *np.degrees(MOVING[::-1]).T],
    ),
    "ros2 topic echo --csv": log(
        [],
        [
            [f"{1_700_000_000 + int(t)}" for t in T],
            [f"{1e9 * (t % 1.0):.0f}" for t in T],
            [""] * len(T),
            *([name] * len(T) for name in NAMES),
            *MOVING.T,
            *OTHER.T,
        ],
    ),
    "Motive": capture(
        [
            "Format Version,1.23,Take Name,a,Capture Frame Rate,50.0,Export Frame Rate,50.0,Length Units,Meters",
            "",
            ",Type," + "Rigid Body," * 8,
            ",Name," + "tool," * 8,
            ",ID," + '"7E1A",' * 8,
            ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error",
            "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,",
        ],
        [FRAMES, T, *OTHER.T[:4], *SEEN.T / 1e3, T * 0],
    ),
    "Vicon": capture(
        ["Trajectories", "50", ",,tool:smr,,,wall:m1,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm"],
        [FRAMES, ["0"] * len(T), *SEEN.T, *WALL.T],
    ),
    "Vicon, segments": capture(
        ["Segments", "50", ",,tool:tool,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,deg,deg,deg,mm,mm,mm"],
        [FRAMES, ["0"] * len(T), *OTHER.T[:3], *SEEN.T],
    ),
    "Qualisys": capture(
        [
            *QUALISYS,
            "MARKER_NAMES\ttool\twall",
            "Frame\tTime\t" + "\t".join(f"{m} {a}" for m in ("tool", "wall") for a in "XYZ"),
        ],
        [FRAMES, T, *SEEN.T, *WALL.T],
        "\t",
    ),
    "Qualisys, points alone": capture([*QUALISYS, "MARKER_NAMES\ttool\twall"], [*SEEN.T, *WALL.T], "\t"),
}
FORMS = POSES | LOGS
USUAL = (
    "figaroh",
    "laser tracker of Leica",
    "German record",
    "sheet with merged cells",
    "libfranka",
    "Motive",
    "Vicon",
)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in USUAL else pytest.mark.thorough) for n in FORMS])
def test_public_forms_are_imported_without_a_mapping(name: str, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(robot_toml())
    out = tmp_path / "cell"
    assert main(["import", str(out), "--robot", str(tmp_path / "robot.toml"), *FORMS[name](tmp_path)]) == 0
    dataset = load_dataset(out)
    assert len(dataset.poses) >= 0.9 * len(Q)
    held_out = np.random.default_rng(9).uniform(LOW, HIGH, (200, 6))
    mine, true = target_points(calibrate(dataset).robot, held_out), tool_mm(held_out)
    assert np.sqrt(np.mean((apply(best_fit_transform(mine, true), mine) - true) ** 2)) < 0.05


REFUSED = {
    "no names": (one([], [*POINTS.T, *NOMINAL.T, *DEG.T]), "write a line of names above them"),
    "no time": (log([",".join(NAMES)], [*MOVING.T]), "are a recording, .* --map COLUMN=time_s"),
    "two sets": (
        one([names("left_q{}", "right_q{}") + ",x,y,z"], [*Q.T, *Q.T, *POINTS.T]),
        "found 2 sets of joint columns",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_told_is_refused_in_a_sentence(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, says = REFUSED[name]
    (tmp_path / "robot.toml").write_text(robot_toml())
    out = tmp_path / "cell"
    assert main(["import", str(out), "--robot", str(tmp_path / "robot.toml"), *make(tmp_path)]) == 2
    assert re.search(says, capsys.readouterr().err)
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
