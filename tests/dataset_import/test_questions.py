"""What no file tells is asked once, with a guess by what was measured: noise, tool, mass, edges, units."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib.corners.edge_length import measured_edge_mm
from calib.frames import rotation_from_rotvec
from calib.scans.scan import Scan
from inspector.cli.parser import main
from tests.support.commands import refused
from tests.support.recorded_run import TOOL_MM, robot_toml, tool_mm

Q = np.random.default_rng(5).uniform([-2.5, -2.2, -2.2, -2.5, -2.0, -2.5], [2.5, -0.4, 2.2, 0.5, 2.0, 2.5], (20, 6))
SIGMA_MM = 0.03


def imported(folder: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, str]:
    """What is asked of a table with three readings a pose, by what the question begins with."""
    rng = np.random.default_rng(6)
    rows = [
        f"P{k}," + ",".join(map(repr, [*q.tolist(), *(tool_mm(q[None])[0] + rng.normal(0, SIGMA_MM, 3)).tolist()]))
        for k, q in enumerate(Q)
        for _ in range(3)
    ]
    (folder / "all.csv").write_text("\n".join(["pose,q1,q2,q3,q4,q5,q6,x,y,z", *rows]))
    (folder / "robot.toml").write_text(robot_toml().replace(str(list(TOOL_MM)), "[0.0, 0.0, 0.0]"))
    given = ["--robot", str(folder / "robot.toml"), "--joints", str(folder / "all.csv"), "--json", "--dry-run"]
    assert main(["import", str(folder / "cell"), *given, *options]) == 0
    asked = json.loads(capsys.readouterr().out)["asked"]
    return {question["what"].split(",")[0]: question["option"] for question in asked}


def test_noise_and_tool_are_guessed_and_what_is_told_is_not_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = imported(tmp_path, capsys)
    assert float(asked["noise of a measured point"].removeprefix("--sigma ")) == pytest.approx(SIGMA_MM, rel=0.3)
    tool = asked["the measured point in the flange's frame"].removeprefix("--tool=").split(",")
    assert [float(value) for value in tool] == pytest.approx(TOOL_MM, abs=3.0)  # the encoders are off by up to 0.3°
    assert imported(tmp_path, capsys, "--sigma", "0.03", f"--tool={','.join(map(str, TOOL_MM))}") == {}


def test_points_in_an_unknown_unit_are_refused_with_the_question(tmp_path: Path) -> None:
    rows = [",".join(map(repr, [*q.tolist(), *(7.0 * tool_mm(q[None])[0]).tolist()])) for q in Q]
    (tmp_path / "all.csv").write_text("\n".join(["q1,q2,q3,q4,q5,q6,x,y,z", *rows]))
    (tmp_path / "robot.toml").write_text(robot_toml())
    said = refused("import", tmp_path / "c", "--robot", tmp_path / "robot.toml", "--joints", tmp_path / "all.csv")
    assert "--map 'x=x_mm'" in said


@pytest.mark.parametrize(("edge_mm", "square"), [(90.0, True), (120.0, False), (40.0, True)])
def test_the_edges_of_a_jig_are_measured_on_its_faces(edge_mm: float, square: bool) -> None:
    rng = np.random.default_rng(int(edge_mm))
    a, b = edge_mm * (np.indices((60, 60)).reshape(2, -1) + 0.5) / 60
    a, b = (a, b) if square else (a[a + b < edge_mm], b[a + b < edge_mm])
    none = np.zeros_like(a)
    faces = np.vstack([np.column_stack(each) for each in ((a, b, none), (a, none, b), (none, a, b))])
    towards = np.cross([1, 1, 1], [0, 0, 1]) / np.sqrt(2) * np.arccos(1 / np.sqrt(3))  # the diagonal along the ray
    points = faces @ rotation_from_rotvec(towards).T + [20.0, -10.0, 500.0]
    assert measured_edge_mm([Scan("s", points + rng.normal(0, 0.03, points.shape))]) == edge_mm
