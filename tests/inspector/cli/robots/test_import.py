"""inspector import: from a URDF and a CSV to a dataset that every command takes."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import load_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.urdf.text import plain_urdf
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main
from tests.support.commands import answered, printed, refused


@pytest.fixture
def given(tmp_path: Path) -> Path:
    """A URDF and a log of an RB5, in metres and radians."""
    robot = builtin_robot("rb5")
    dataset = simulate_dataset(robot, rng=2, poses=40, noise_mm=0.02).dataset
    (tmp_path / "arm.urdf").write_text(plain_urdf(chain_of(robot)))
    header = ",".join([*(f"joint_{k}" for k in range(1, 7)), "x", "y", "z"])
    rows = np.hstack([dataset.poses.q, 1e-3 * dataset.points.xyz_mm])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    return tmp_path


@pytest.mark.slow
def test_the_one_json_object_has_what_was_recognised(given: Path) -> None:
    arguments = ["--robot", "rb5", "--joints", str(given / "log.csv"), "--map", "z=z_m", "--json"]
    assert "have different units" in refused("import", given / "cell", *arguments, "--map", "x=x_mm")
    maps = ["--map", "x=x_m", "--map", "y=y_m"]
    document = json.loads(printed("import", given / "cell", *arguments, *maps))
    assert document["roles"] == {"reference": 1, "train": 29, "test": 10}
    assert any("in m " in line for line in document["recognised"])


def packed(given: Path, *names: str) -> Path:
    with zipfile.ZipFile(given / "my.zip", "w") as archive:
        for name in names:
            archive.write(given / name, name)
    return given / "my.zip"


def test_a_plan_with_faults_lists_them_and_ends_with_1(given: Path) -> None:
    source = packed(given, "log.csv")
    (fault,) = answered("import", given / "cell", "--from", source, "--dry-run", code=1)["faults"]
    assert "no robot is chosen" in fault
    assert "no robot is chosen" in refused("import", given / "cell", "--from", source)
    assert "--joints" in refused("import", given / "cell", "--joints", "a.csv")


@pytest.mark.slow
def test_from_a_urdf_and_a_csv_to_the_first_diagnosis(given: Path) -> None:
    files = ["--robot", str(given / "arm.urdf"), "--joints", str(given / "log.csv")]
    document = answered("import", given / "cell", *files, "--diagnose")
    assert document["poses"] == 40
    assert document["diagnosis"]["verdict"] == "adequate"


@pytest.mark.slow
def test_bad_rows_are_left_out_where_asked_with_sigma_and_tool(given: Path, capsys: pytest.CaptureFixture[str]) -> None:
    header, *rows = (given / "log.csv").read_text().splitlines()
    rows[4] = rows[4].replace(",", ",n/a ", 1)
    (given / "log.csv").write_text("\n".join([header, *rows]))
    arguments = ["import", str(given / "cell"), "--robot", str(given / "arm.urdf"), "--joints", str(given / "log.csv")]
    assert main(arguments) == 2
    assert "--skip-bad-rows leaves out the row that cannot be read" in capsys.readouterr().err
    document = answered(*arguments, "--dry-run", code=1)
    assert [(row["table"], row["line"], row["column"]) for row in document["bad_rows"]] == [("log.csv", 6, "joint_2")]
    assert document["bad_rows_left_out"] is False
    assert main([*arguments, "--skip-bad-rows", "--sigma", "0.02", "--tool=0,0,0.5", "--json"]) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["bad_rows_left_out"] is True
    assert document["preview"] == "39 poses, 39 points."
    for notes in (document["recognised"], document["warnings"], told.err.splitlines()):
        assert any("log.csv: 1 of 40 rows is left out" in note and "line 6" in note for note in notes)
    made = load_dataset(given / "cell")
    assert made.scanner.point_sigma_mm == 0.02
    assert made.robot.own_tool_point is not None
    for wrong in (("--sigma", "0"), ("--tool", "1,2")):
        with pytest.raises(SystemExit) as ended:
            main([*arguments, *wrong])
        assert ended.value.code == 2


def test_a_ready_dataset_takes_neither_sigma_nor_tool(tmp_path: Path) -> None:
    assert "--sigma" in refused("import", tmp_path / "cell", "--from", "sample_data/hidden_effect_a", "--sigma", "0.1")
