"""Arms of one and of two joints, and data without noise: every command answers, or says in one line why it cannot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.folder import write_dataset
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Joint, Robot, Tool
from inspector.cli.parser import main
from tests.support.sweeps import sweep

NOTES = ("inspector: warning", "inspector: note")
COMMANDS = (
    ("calibrate",), ("calibrate", "--residual", "distance"), ("calibrate", "--residual", "pairs"),
    ("calibrate", "--no-prior"), ("calibrate", "--model-out", "OUT/model.json", "--session", "OUT/s.json"),
    ("diagnose",), ("diagnose", "--model-out", "OUT/model.json"), ("check",), ("redundancy",), ("validate",),
    ("plan",), ("plan", "--for", "split"), ("plan", "--for", "joint_compliance"),
    ("report", "--out", "OUT/report.html"), ("correct", "--joints", "CELL/poses.csv", "--out", "OUT/c.csv"),
    ("compare", "CELL"),
)  # fmt: skip


def few_joints(joints: int, kind: str, *, poses: int = 20, noise_mm: float = 0.05, declared: bool = True) -> Dataset:
    """An arm of so few joints: its target off every axis, on the last axis, or carried along a slide."""
    links = tuple(
        Joint(
            a_mm=150.0, alpha_rad=np.pi / 2 * k, d_mm=80.0, name=f"J{k + 1}", mass_kg=4.0, com_mm=(0.0, 10.0, 5.0),
            type="prismatic" if kind == "slide" and k == 0 else "revolute",
        )
        for k in range(joints)
    )  # fmt: skip
    if kind == "on the axis":
        links = (*links[:-1], replace(links[-1], a_mm=0.0))
    robot = Robot("few", links, Tool(a_mm=0.0 if kind == "on the axis" else 60.0, d_mm=90.0))
    rng = np.random.default_rng(4)
    q = rng.uniform(-1.5, 1.5, (poses, joints)) * np.where(robot.is_revolute, 1.0, 200.0)
    true = robot.with_table(robot.table + rng.normal(size=robot.table.shape) * [0.3, 2e-3, 0.3, 2e-3, 2e-3])
    xyz_mm = target_points(true, q) + [30.0, 400.0, 900.0] + noise_mm * rng.normal(size=(poses, 3))
    role = np.where(np.arange(poses) % 5 == 4, "test", "train").astype("U9")
    role[0] = "reference"
    ids = tuple(f"p{i}" for i in range(poses))
    return Dataset(
        "few",
        robot,
        Poses(ids, role, q, np.full(poses, ""), tuple(f"{i}.ply" for i in ids)),
        Points(np.arange(poses), xyz_mm, np.full(poses, "jig")),
        scanner=Scanner(point_sigma_mm=0.05 if declared else None),
    )


def ends_well(capsys: pytest.CaptureFixture[str], folder: Path, *words: str) -> int:
    """Run a command on the cell in `folder`; exit code 0 or 1, or 2 with one line and nothing left behind."""
    out = folder / "out"
    told = [word.replace("CELL", str(folder / "cell")).replace("OUT", str(out)) for word in words]
    capsys.readouterr()
    code = main([told[0], str(folder / "cell"), *told[1:]])
    said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(NOTES)]
    assert code in (0, 1, 2)
    if code == 2:
        assert len(said) == 1, (words, said)
        assert "internal error" not in said[0], (words, said)
        assert not out.exists() or not any(out.iterdir()), words
    for file in out.iterdir() if out.exists() else ():
        file.unlink()
    return code


@pytest.mark.slow
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
@pytest.mark.slow
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
    assert points is not None
    measured = points.pose > 0
    unmeasured = Points(points.pose[measured], points.xyz_mm[measured], points.target[measured])
    if len(unmeasured.pose):  # the reference pose is the only one to train with, and has no point
        other = replace(dataset, poses=replace(dataset.poses, role=role), points=unmeasured)
        write_dataset(other, tmp_path / "untrained" / "cell")
        for words in COMMANDS:
            ends_well(capsys, tmp_path / "untrained", *words)
