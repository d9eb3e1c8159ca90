"""Arms of one and of two joints, and data without noise: every command answers, or says in one line why it cannot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Points
from calib.dataset.files.folder import write_dataset
from tests.support.few_joints import ends_well, few_joints
from tests.support.sweeps import sweep

COMMANDS = (
    ("calibrate",), ("calibrate", "--residual", "distance"), ("calibrate", "--residual", "pairs"),
    ("calibrate", "--no-prior"), ("calibrate", "--model-out", "OUT/model.json", "--session", "OUT/s.json"),
    ("diagnose",), ("diagnose", "--model-out", "OUT/model.json"), ("check",), ("redundancy",), ("validate",),
    ("plan",), ("plan", "--for", "split"), ("plan", "--for", "joint_compliance"),
    ("report", "--out", "OUT/report.html"), ("correct", "--joints", "CELL/poses.csv", "--out", "OUT/c.csv"),
    ("compare", "CELL"),
)  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kind", "joints"),
    sweep(
        [(kind, joints) for kind in ("plain", "on the axis", "slide") for joints in (1, 2)],
        every_run=[("plain", 2), ("slide", 1)],
    ),
)
def test_every_command_ends_well_for_few_joints(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, joints: int, kind: str
) -> None:
    write_dataset(few_joints(joints, kind), tmp_path / "cell")
    codes = {words: ends_well(capsys, tmp_path, *words) for words in COMMANDS}
    if kind == "plain":
        answered = [words for words in (("calibrate",), ("diagnose",), ("redundancy",)) if codes[words] == 0]
        assert len(answered) == 3, codes


@pytest.mark.thorough
@pytest.mark.parametrize("declared", sweep([True, False], every_run=[True]))
def test_every_command_ends_well_for_data_without_noise(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, declared: bool
) -> None:
    write_dataset(few_joints(2, "plain", noise_mm=0.0, declared=declared), tmp_path / "cell")
    for words in COMMANDS:
        ends_well(capsys, tmp_path, *words)


@pytest.mark.slow
@pytest.mark.parametrize("poses", sweep([1, 2, 3, 5], every_run=[1, 3]))
def test_every_command_ends_well_for_few_poses_and_for_none_to_train_with(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, poses: int
) -> None:
    dataset = few_joints(3, "plain", poses=poses)
    write_dataset(dataset, tmp_path / "cell")
    for words in COMMANDS:
        ends_well(capsys, tmp_path, *words)
    role = np.where(dataset.poses.role == "reference", "reference", "test")
    points = dataset.points
    measured = points.pose > 0
    unmeasured = Points(points.pose[measured], points.xyz_mm[measured], points.target[measured])
    if len(unmeasured.pose):  # the reference pose is the only one to train with, and has no point
        other = replace(dataset, poses=replace(dataset.poses, role=role), points=unmeasured)
        write_dataset(other, tmp_path / "untrained" / "cell")
        for words in COMMANDS:
            ends_well(capsys, tmp_path / "untrained", *words)
