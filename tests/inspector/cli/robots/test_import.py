"""inspector import: from a URDF and a CSV to a dataset that every command takes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.robot_toml import builtin_robot
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.urdf.text import plain_urdf
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main


@pytest.fixture
def given(tmp_path: Path) -> Path:
    """A URDF and a log of an RB5, in metres and radians."""
    robot = builtin_robot("rb5")
    dataset = simulate_dataset(robot, rng=np.random.default_rng(2), poses=40, noise_mm=0.02).dataset
    assert dataset.points is not None
    (tmp_path / "arm.urdf").write_text(plain_urdf(chain_of(robot)))
    header = ",".join([*(f"joint_{k}" for k in range(1, 7)), "x", "y", "z"])
    rows = np.hstack([dataset.poses.q, 1e-3 * dataset.points.xyz_mm])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return tmp_path


def test_it_says_what_it_took_columns_for(given: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "import",
        str(given / "cell"),
        "--robot",
        str(given / "arm.urdf"),
        "--joints",
        str(given / "log.csv"),
    ]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "angles are taken for rad" in said
    assert "points are x, y, z, taken for m" in said
    assert "40 poses (1 reference, 29 train, 10 test)" in said
    assert main(["calibrate", str(given / "cell"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["test"]["rmse_mm"] < 0.2
    assert main([*arguments, "--json"]) == 2
    assert "exists and is not empty" in capsys.readouterr().err


def test_the_one_json_object_has_what_was_recognised(given: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--robot", "rb5", "--joints", str(given / "log.csv"), "--map", "z=z_m", "--json"]
    assert main(["import", str(given / "cell"), *arguments]) == 2
    assert "have different units" in capsys.readouterr().err
    maps = ["--map", "x=x_m", "--map", "y=y_m"]
    assert main(["import", str(given / "cell"), *arguments, *maps]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["roles"] == {"reference": 1, "train": 29, "test": 10}
    assert any("in m by their names" in line for line in document["recognised"])
