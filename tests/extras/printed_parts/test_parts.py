"""Parts to print: closed, of the right size and volume by another library, and a ball rests where it is said to."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.extras.printed_parts.bolt_circle import bolt_circle
from calib.extras.printed_parts.flange_parts import BallStem, CornerJig
from calib.extras.printed_parts.part import PartError, PrintedPart
from calib.extras.printed_parts.socket_plate import SocketPlate
from inspector.cli.parser import main


def as_mesh(part: PrintedPart) -> trimesh.Trimesh:
    """The part as another library reads its file."""
    mesh = trimesh.load(io.BytesIO(part.stl()), file_type="stl")
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


@pytest.mark.parametrize(
    ("part", "holes", "size_mm", "volume_mm3"),
    [
        (SocketPlate(), 4, (128.0, 78.0, 10.0), 97796.8936),
        (CornerJig(), 4, (84.852814, 82.189795, 113.130811), 172100.7549),
        (CornerJig(edge_mm=40.0, bolts="31.5-4-M5"), 4, (56.568542, 55.859863, 93.753874), 55227.0683),
        (CornerJig(bolts="ISO 9409-1-80-6-M8"), 6, (99.4, 99.4, 99.630811), 282493.6942),
        (BallStem(), 4, (66.4, 66.4, 73.928932), 68455.2833),
        (BallStem(ball_mm=12.7, bolts="31.5-4-M5"), 4, (46.4, 46.4, 76.509872), 28444.4249),
    ],
)
def test_a_part_is_closed_has_its_holes_and_the_size_that_other_code_gave_it(
    part: SocketPlate | CornerJig | BallStem, holes: int, size_mm: tuple[float, ...], volume_mm3: float
) -> None:
    """Sizes, and volumes but for the widening neck of a corner, are those of triangles that no library made."""
    mesh = as_mesh(part.part())
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert 2 - mesh.euler_number == 2 * holes  # a hole through is a handle
    assert mesh.extents == pytest.approx(size_mm, abs=1e-3)
    assert mesh.volume == pytest.approx(volume_mm3, rel=1e-5)


def test_a_plate_has_the_volume_of_a_block_less_its_sockets_and_holes() -> None:
    plate = SocketPlate(columns=2, rows=2, pitch_mm=60.0)
    part = plate.part()
    x, y, z = part.solid.extents
    cone = np.pi / 3 * (plate.rim_mm**3 - (plate.rim_mm - plate.socket_depth_mm) ** 3)
    mark = np.pi / 3 * 1.0 * (2.0**2 + 1.0**2 + 2.0)
    holes = 4 * np.pi * 2.75**2 * z
    assert part.solid.volume == pytest.approx(x * y * z - 4 * cone - mark - holes, rel=1e-4)


@settings(max_examples=12, deadline=None)
@given(ball_mm=st.floats(8.0, 40.0))
def test_a_ball_rests_where_the_table_says(ball_mm: float) -> None:
    plate = SocketPlate(columns=2, pitch_mm=120.0, ball_mm=ball_mm)
    mesh = as_mesh(plate.part())
    for centre in plate.centres():
        at_mm = np.tile(centre.xyz_mm, (len(mesh.faces), 1))
        nearest_mm = trimesh.triangles.closest_point(mesh.triangles, at_mm)
        gap_mm = np.linalg.norm(nearest_mm - at_mm, axis=1).min() - ball_mm / 2
        assert abs(gap_mm) < 0.01  # it touches, and does not go in; sides of a polygon stand for the cone


def test_the_corner_has_three_square_faces_that_meet_at_its_apex() -> None:
    part = CornerJig(edge_mm=50.0).part()
    mesh = as_mesh(part)
    apex = np.array(part.points[0].xyz_mm)
    at_apex = np.linalg.norm(mesh.vertices[mesh.faces] - apex, axis=2).min(axis=1) < 1e-3
    normals = np.unique(np.round(mesh.face_normals[at_apex], 4), axis=0)
    assert len(normals) == 3
    assert np.abs(normals @ normals.T - np.eye(3)).max() < 1e-3
    assert normals[:, 2] == pytest.approx(1.0 / np.sqrt(3.0), abs=1e-3)
    reach_mm = np.linalg.norm(mesh.vertices[np.unique(mesh.faces[at_apex])] - apex, axis=1).max()
    assert reach_mm == pytest.approx(50.0, abs=0.01)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: SocketPlate(pitch_mm=10.0), "overlap; take"),
        (lambda: SocketPlate(ball_mm=float("nan")), "ball: found nan"),
        (lambda: CornerJig(edge_mm=500.0), "10 to 300 mm"),
        (lambda: CornerJig(bolts="50-4"), "expected DIAMETER-COUNT-THREAD"),
        (lambda: bolt_circle("50-12-M8"), "take fewer bolts"),
        (lambda: BallStem(length_mm=10.0), "too short"),
    ],
)
def test_what_cannot_be_printed_is_refused(make, says: str) -> None:
    with pytest.raises(PartError, match=says):
        make()


def test_the_command_writes_the_plate_and_its_centres(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.stl"
    assert main(["jig", "plate", "--sockets", "3x2", "--pitch-mm", "80", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["files"] == [str(out), str(tmp_path / "mine.csv")]
    mesh = trimesh.load(out)
    assert mesh.extents == pytest.approx(told["size_mm"], abs=1e-3)
    rows = list(csv.DictReader((tmp_path / "mine.csv").open()))
    assert [row["socket"] for row in rows] == ["A1", "B1", "C1", "A2", "B2", "C2"]
    assert float(rows[-1]["x_mm"]) == 160.0


@pytest.mark.parametrize(
    "words", [["corner", "--bolts", "5-4-M6"], ["plate", "--out", "plate.step"], ["stem", "--ball-mm", "300"]]
)
def test_bad_input_is_one_line_and_nothing_is_written(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["jig", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
