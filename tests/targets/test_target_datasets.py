"""Several targets a scan, through dataset.toml and the commands: found, named by size or by the robot, fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib.dataset.files.folder import load_dataset, write_dataset
from calib.errors import DatasetError
from calib.measurement.measured_points import with_corners
from calib.target_shapes import DeclaredTarget, OwnShape, Socket, Sphere, Spheres
from calib.targets.search import find_targets
from tests.support.ball_dataset import write_ball_dataset
from tests.support.commands import answered, refused

OFFSETS = {"b": np.array([60.0, 10, 90]), "c": np.array([-50.0, 30, 60])}
TABLES = """[[targets]]
name = "jig"
shape = "sphere"
diameter_mm = 30.0

[[targets]]
name = "b"
shape = "sphere"
diameter_mm = 20.0

[[targets]]
name = "c"
shape = "sphere"
diameter_mm = 20.0
"""


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, np.ndarray]]:
    folder = tmp_path_factory.mktemp("balls") / "cell"
    truth = write_ball_dataset(
        folder,
        TABLES,
        offsets=OFFSETS,
        diameters_mm={"jig": 30.0, "b": 20.0, "c": 20.0},
        poses=16,
        rays=12_000,
    )
    return folder, truth


@pytest.mark.slow
def test_three_balls_two_of_them_alike_become_points_with_names(
    balls: tuple[Path, dict[str, np.ndarray]], tmp_path: Path
) -> None:
    folder, truth = balls
    out = tmp_path / "points.csv"
    document = answered("corners", folder, "--out", out, "--processes", "1")
    assert document["corners"] == []
    assert len(document["targets"]) + len(document["targets_failed"]) == 3 * 16
    assert len(document["targets_failed"]) <= 2  # one ball hides another
    ids = list(pd.read_csv(folder / "poses.csv").pose)
    points = pd.read_csv(out)
    for name, places in truth.items():
        rows = points[points.target == name]
        found = rows[["x_mm", "y_mm", "z_mm"]].to_numpy(dtype=float)
        there = places[[ids.index(pose) for pose in rows.pose]]
        assert len(rows) >= 14
        assert np.linalg.norm(found - there, axis=1).max() < 0.06  # the two that look alike are 114 mm apart


@pytest.mark.slow
def test_a_finder_of_the_users_own(balls: tuple[Path, dict[str, np.ndarray]], tmp_path: Path) -> None:
    """The user's function here takes the mean of all points; it is called for every target, as none is `own`."""
    own = tmp_path / "mine.py"
    own.write_text(
        "import numpy as np\n\n\ndef find(scan, wanted):\n"
        "    if wanted.names[0] != 'jig':\n        return 'nothing of mine'\n"
        "    return scan.points_mm.mean(axis=0), np.eye(3)\n"
    )
    document = answered("corners", balls[0], "--finder", own, "--processes", "1")
    assert {found["target"] for found in document["targets"]} == {"jig"}
    assert {failed["reason"] for failed in document["targets_failed"]} == {"nothing of mine"}
    own.write_text("def find(scan, wanted):\n    return 1 / 0\n")
    said = refused("corners", balls[0], "--finder", own, "--processes", "1")
    assert f"{own}: line 2: ZeroDivisionError: division by zero" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("def find(scan, wanted)\n", "line 1: expected ':'"),
        ("x = 1\n", "found no function `find`"),
        ("import nonsense_that_is_not_there\n", "line 1: ModuleNotFoundError"),
        ("raise SystemExit(3)\n", "line 1: SystemExit"),
    ],
)
def test_a_finder_file_that_is_none_is_told_in_a_line(
    text: str,
    reason: str,
    balls: tuple[Path, dict[str, np.ndarray]],
    tmp_path: Path,
) -> None:
    file = tmp_path / "finder.py"
    file.write_text(text)
    said = refused("corners", balls[0], "--finder", file)
    assert reason in said
    assert len(said.strip().splitlines()) == 1


@pytest.mark.slow
def test_what_moves_on_the_tool_is_no_target(balls: tuple[Path, dict[str, np.ndarray]]) -> None:
    dataset = load_dataset(balls[0])
    searches = find_targets(dataset, intermediate=False)
    pose = dataset.poses.ids[4]
    search = searches[pose]
    jig, others = search.found  # type: ignore[attr-defined]
    moved = type(jig.places[0])(**{**vars(jig.places[0]), "xyz_mm": jig.places[0].xyz_mm + np.array([0.0, 0, 5])})
    wrong = type(jig)(jig.names, (moved,), "")
    searches[pose] = type(search)(**{**vars(search), "found": (wrong, others)})
    points = with_corners(dataset, searches).points
    at_pose = points.target[points.pose == 4].tolist()
    assert sorted(at_pose) == ["b", "c"]


def test_shapes_of_targets_are_written_and_read(balls: tuple[Path, dict[str, np.ndarray]], tmp_path: Path) -> None:
    dataset = load_dataset(balls[0])
    for shape in (Sphere(), Socket(12.0, 0.002), OwnShape({"height_mm": 3.0})):
        written = replace(dataset, targets=(DeclaredTarget("b", shape),))
        write_dataset(written, tmp_path / "again")
        assert load_dataset(tmp_path / "again").targets == (DeclaredTarget("b", shape),)
    rig = DeclaredTarget("rig", Spheres(("jig", "b", "c"), (80.0, 90.0, 100.0), 20.0))
    write_dataset(replace(dataset, targets=(rig,)), tmp_path / "again")
    assert load_dataset(tmp_path / "again").targets == (rig,)


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ('name = "b"\nshape = "ball"', r"\[\[targets\]\] 1\.shape: found 'ball'"),
        ('name = "b"', r"\[\[targets\]\] 1\.shape: the key is missing"),
        ('shape = "sphere"', r"\[\[targets\]\] 1\.name: the key is missing"),
        ('name = "z"\nshape = "sphere"', r"found 'z'; robot.toml knows jig, b, c"),
        ('name = "b"\nshape = "sphere"\ndiameter_mm = 0.02', "found 0.02 mm"),
        ('name = "b"\nshape = "sphere"\nradius_mm = 5.0', "radius_mm: is no key"),
        ('name = "b"\nshape = "spheres"\nspheres = ["b", "c"]', "three or more names"),
    ],
)
def test_a_table_that_tells_no_target_is_refused(
    table: str, reason: str, balls: tuple[Path, dict[str, np.ndarray]], tmp_path: Path
) -> None:
    write_dataset(replace(load_dataset(balls[0]), targets=()), tmp_path)
    with (tmp_path / "dataset.toml").open("a") as file:
        file.write(f"\n[[targets]]\n{table}\n")
    with pytest.raises(DatasetError, match=reason):
        load_dataset(tmp_path)
