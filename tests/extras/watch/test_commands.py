"""The command `watch`, and check poses by `plan --for watch`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calib.dataset.files.folder import write_dataset
from calib.dataset.files.robot_toml import builtin_robot
from calib.simulation.simulate import simulate_dataset
from inspector.cli.parser import main
from tests.support.few_joints import ends_well, few_joints
from tests.support.sweeps import sweep

COMMANDS = (("plan", "--for", "watch"), ("watch", "CELL"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cell") / "cell"
    made = simulate_dataset(builtin_robot("rb5"), rng=np.random.default_rng(4), poses=45, effects=("joint_compliance",))
    write_dataset(made.dataset, folder)
    return folder


@pytest.mark.slow
def test_check_poses_for_a_calibration_and_for_nothing_else(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "rb5", "--for", "watch"]) == 2
    assert "against a calibration" in capsys.readouterr().err
    checks = folder.parent / "checks.csv"
    told = ["plan", str(folder), "--for", "watch", "--effect", "joint_compliance", "--out", str(checks)]
    assert main(told) == 0
    roles = pd.read_csv(checks)["role"].tolist()
    assert roles == ["reference", *["train"] * 7]  # as they are, the poses of a new dataset
    said = capsys.readouterr().out
    assert said.startswith("8 poses for ")
    assert "to watch the cell" in said
    assert "found from" in said
    assert "19 times of 20" in said
    assert "predicted error" not in said
    assert main([*told, "--json"]) == 0
    promised = {(c["what"], c["joint"]): c for c in json.loads(capsys.readouterr().out)["check"]}
    slip = promised["joint_zero", 3]
    assert 0.0 < slip["found_from"] < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "joints", "poses"),
    sweep(
        [
            ("plain", 1, 20),
            ("plain", 2, 20),
            ("slide", 1, 20),
            ("on the axis", 2, 20),
            ("plain", 3, 1),
            ("plain", 3, 3),
        ],
        every_run=[("slide", 1, 20), ("plain", 3, 3)],
    ),
)
def test_few_joints_and_few_poses_end_well(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, kind: str, joints: int, poses: int
) -> None:
    write_dataset(few_joints(joints, kind, poses=poses), tmp_path / "cell")
    for words in COMMANDS:
        ends_well(capsys, tmp_path, *words)


@pytest.mark.thorough
def test_data_without_noise_are_unchanged(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_dataset(few_joints(2, "plain", noise_mm=0.0), tmp_path / "cell")
    assert ends_well(capsys, tmp_path, "watch", "CELL") == 0
