"""Public layouts of tables and logs: files of an arm by another code, and what an import has to make of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from calib import calibrate
from calib.dataset.files.folder import load_dataset
from calib.frames import apply, best_fit_transform
from calib.kinematics.chain import target_points
from calib.statistics import rms
from inspector.cli.parser import main
from tests.support.recorded_run import robot_toml, tool_mm

Array = np.ndarray
LOW, HIGH = np.array([-2.5, -2.2, -2.2, -2.5, -2.0, -2.5]), np.array([2.5, -0.4, 2.2, 0.5, 2.0, 2.5])
Q = np.random.default_rng(3).uniform(LOW, HIGH, (36, 6))
POINTS = tool_mm(Q) + np.random.default_rng(4).normal(0.0, 0.03, (36, 3))
NOMINAL = tool_mm(Q, (0.0,) * 6)
DEG = np.degrees(Q)
J = [f"J{k}" for k in range(1, 7)]
Cells = Sequence[Sequence[object]]
Form = Callable[[Path], list[str]]


def text(
    path: Path, head: Sequence[str], columns: Sequence[Array | Sequence[str]], sep: str = ",", number: str = "{:.6f}",
    encoding: str = "utf-8", decimal: str = ".",
) -> str:  # fmt: skip
    """File of lines of a head and of columns of numbers or words."""
    lists = [[*each] for each in columns]
    rows = [
        [c if isinstance(c, str) else number.format(c).replace(".", decimal) for c in row]
        for row in zip(*lists, strict=True)
    ]
    path.write_text("\n".join([*head, *(sep.join(row) for row in rows)]) + "\n", encoding=encoding)
    return str(path)


def names(*stems: str, first: int = 0) -> str:
    return ",".join(stem.format(k) for stem in stems for k in range(first, first + 6))


def require_import(form: Form, folder: Path) -> None:
    """The form is imported without a mapping, and its fit holds at poses of the true arm."""
    (folder / "robot.toml").write_text(robot_toml())
    out = folder / "cell"
    assert main(["import", str(out), "--robot", str(folder / "robot.toml"), *form(folder)]) == 0
    dataset = load_dataset(out)
    assert len(dataset.poses) >= 0.9 * len(Q)
    held_out = np.random.default_rng(9).uniform(LOW, HIGH, (200, 6))
    mine, true = target_points(calibrate(dataset).robot, held_out), tool_mm(held_out)
    assert rms(apply(best_fit_transform(mine, true), mine) - true) < 0.05
