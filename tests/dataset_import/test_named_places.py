"""Import of visits of known places: the joints' table names the socket, the plate's table says where each is."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import calibrate, load_dataset
from inspector.cli.parser import main
from tests.support.camera_scene import flange, joints_to, nominal_table, transform

SOCKETS = {"A1": (0, 0, 0), "B1": (120, 0, 0), "A2": (0, 120, 0), "B2": (120, 120, 0)}
BALL_MM = np.array([5.0, -8.0, 80.0])  # in the flange
LINK_MM, LINK_RAD = 0.4, 0.0008


@pytest.fixture(scope="module")
def visits(tmp_path_factory) -> Path:
    """Folder with joints.csv, 60 visits of a plate that stood at two places, and plate.csv."""
    folder, rng = tmp_path_factory.mktemp("visits"), np.random.default_rng(8)
    nominal = nominal_table()
    sigma = np.array([LINK_MM, LINK_RAD, LINK_MM, LINK_RAD, LINK_RAD])
    true = nominal + rng.normal(size=nominal.shape) * sigma
    plates = {
        "left": transform(Rotation.from_euler("z", 20, degrees=True), [380.0, 150.0, 60.0]),
        "right": transform(Rotation.from_euler("zx", [-60, 10], degrees=True), [420.0, -250.0, 120.0]),
    }
    rows = []
    while len(rows) < 60:
        name, place = rng.choice(list(SOCKETS)), rng.choice(list(plates))
        seat = (plates[place] @ np.append(SOCKETS[name], 1.0))[:3]
        turn = Rotation.from_euler("xyz", [180 + rng.uniform(-50, 50), rng.uniform(-50, 50), rng.uniform(-180, 180)],
                                   degrees=True)  # fmt: skip
        wanted = transform(turn, seat - turn.apply(BALL_MM))
        q = joints_to(true, wanted, rng)  # the ball rests in the socket, where the true arm is
        if q is not None:
            assert flange(true, q) @ np.append(BALL_MM, 1.0) == pytest.approx(np.append(seat, 1.0), abs=1e-4)
            noise = rng.normal(size=6) * 5e-5
            rows.append([*map(repr, np.degrees(q + noise).tolist()), name, place])
    with (folder / "joints.csv").open("w", newline="") as file:
        csv.writer(file).writerows([[*(f"q{k + 1}_deg" for k in range(6)), "Socket", "setup"], *rows])
    with (folder / "plate.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["socket", "x_mm", "y_mm", "z_mm"], *([n, *xyz] for n, xyz in SOCKETS.items())])
    return folder


def importing(folder: Path, out: Path, joints: str = "joints.csv") -> int:
    return main([
        "import", str(out), "--robot", "rb5", "--joints", str(folder / joints), "--points", str(folder / "plate.csv"),
        "--sigma", "0.05",
    ])  # fmt: skip


def test_each_visit_gets_the_place_of_its_socket(visits, tmp_path, capsys):
    assert importing(visits, tmp_path / "cell") == 0
    assert "60 visits of 4 places" in capsys.readouterr().out
    dataset = load_dataset(tmp_path / "cell")
    with (visits / "joints.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [tuple(xyz) for xyz in dataset.points.xyz_mm.tolist()] == [SOCKETS[row["Socket"]] for row in rows]
    assert list(dataset.poses.setup) == [row["setup"] for row in rows]
    fitted = calibrate(dataset)
    assert fitted.before.test.rmse_mm > 0.5
    assert fitted.after.test.rmse_mm < 0.15


def test_a_socket_that_the_plate_has_not_is_one_clear_fault(visits, tmp_path, capsys):
    text = (visits / "joints.csv").read_text().replace(",B2,", ",C9,", 1)
    (visits / "wrong.csv").write_text(text)
    assert importing(visits, tmp_path / "cell", "wrong.csv") == 2
    said = capsys.readouterr().err
    assert "column Socket: 'C9' is not in" in said
    assert "(A1, B1, A2, B2)" in said
    assert not (tmp_path / "cell").exists()
