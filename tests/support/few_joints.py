"""Arms of few joints, and commands that end well on them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.kinematics.chain import target_points
from calib.kinematics.robot import Joint, Robot, Tool
from inspector.cli.parser import main

NOTES = ("inspector: warning", "inspector: note")


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
