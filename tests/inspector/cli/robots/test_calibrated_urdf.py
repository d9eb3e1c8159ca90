"""inspector calibrate --urdf-out: the user's own URDF with calibrated origins."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.files.folder import write_dataset
from calib.dataset.files.robot_toml import builtin_robot, load_robot_toml
from calib.kinematics.chain import nominal_chain
from calib.robot_formats.chain.five_parameters import chain_of
from calib.robot_formats.origin_yaml import plain_yaml
from calib.robot_formats.robot_file import read_robot
from calib.robot_formats.urdf.text import plain_urdf
from calib.simulation.simulate import simulate_dataset
from tests.support.commands import answered, printed, refused


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of an RB5 whose URDF lies beside it."""
    folder = tmp_path_factory.mktemp("cell")
    robot = builtin_robot("rb5")
    simulation = simulate_dataset(robot, rng=1, poses=30, noise_mm=0.02, effects=["joint_compliance"])
    write_dataset(simulation.dataset, folder / "data")
    (folder / "arm.urdf").write_text(plain_urdf(chain_of(robot)))
    return folder


@pytest.mark.slow
def test_the_written_file_is_the_exported_table_and_tells_what_it_leaves_out(cell: Path, tmp_path: Path) -> None:
    out, toml = tmp_path / "calibrated.urdf", tmp_path / "robot.toml"
    more = ["--effect", "joint_compliance", "--out", str(toml), "--json"]
    template = ["--template", str(cell / "arm.urdf")]
    document = json.loads(printed("calibrate", cell / "data", "--urdf-out", out, *template, *more))
    assert document["urdf"]["left_out"] == ["joint_compliance"]
    assert "no origin holds joint_compliance" in document["urdf"]["notes"][0]
    table, written = load_robot_toml(toml), read_robot(out).robot
    q = np.random.default_rng(0).uniform(-2, 2, (50, 6))
    places = [nominal_chain(r, q).base_T_frame[:, -1] for r in (table, written)]
    assert np.abs(places[0] - places[1]).max() < 1e-9
    before, after = (cell / "arm.urdf").read_text().splitlines(), out.read_text().splitlines()
    assert [line for line in before if "<origin" not in line] == [
        line for line in after if "<origin" not in line and "origins calibrated by" not in line
    ]
    assert "origins calibrated by robot-calibration-inspector" in after[2]


def test_a_template_of_another_arm_is_refused_before_the_fit(cell: Path, tmp_path: Path) -> None:
    other, out = tmp_path / "panda.urdf", tmp_path / "calibrated.urdf"
    other.write_text(plain_urdf(chain_of(builtin_robot("panda"))))
    assert "has 7 joints" in refused("calibrate", cell / "data", "--urdf-out", out, "--template", other)
    assert "--template ROBOT.urdf" in refused("calibrate", cell / "data", "--urdf-out", out)
    xacro = tmp_path / "arm.xacro"
    assert "give --kinematics-out" in refused("calibrate", cell / "data", "--urdf-out", out, "--template", xacro)
    assert not out.exists()


def test_a_kinematics_file_gets_the_same_origins_and_keeps_its_hash(cell: Path, tmp_path: Path) -> None:
    own, out, urdf = tmp_path / "own.yaml", tmp_path / "out.yaml", tmp_path / "out.urdf"
    own.write_text(plain_yaml(chain_of(builtin_robot("rb5"))) + "  hash: calib_42\n")
    outputs = ["--kinematics-out", str(out), "--urdf-out", str(urdf)]
    templates = ["--template", str(own), "--template", str(cell / "arm.urdf")]
    document = answered("calibrate", cell / "data", *outputs, *templates)
    assert document["kinematics"]["changed"] == document["urdf"]["changed"][:-1]
    assert out.read_text().endswith("  hash: calib_42\n")
    one, other = read_robot(out), read_robot(urdf)
    for mine, theirs in zip(one.chain.joints, other.chain.joints, strict=True):
        assert mine.before_T_joint == pytest.approx(theirs.before_T_joint, abs=1e-9)
