"""Real arms, and simulated ones whose truth is known, each as a problem for every tool."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from problem import Array, Problem
from tools.dh import points_of

from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.folder import load_dataset, write_dataset
from calib.robot_formats.robots import load_robot

HERE = Path(__file__).parent
SAMPLES = HERE.parents[1] / "sample_data"


@dataclass(frozen=True)
class FieldSet:
    """A set of measurements with its frozen split."""

    name: str
    arm: str  # arm and instrument, in words
    source: str  # where it is from, with commit and licence
    load: Callable[[], Dataset]


UR10 = "github.com/christianlandgraf/ipa-robot-accuracy at 507fba6, MIT"
MUKCA = "github.com/platonics-delft/kinematics_calibration at 05a05ab, MIT"
JACOBI = "github.com/pauljac7700/serial_robots_datasets at 759068d, MIT"
SOCKETS = "Panda, a ball in sockets, test at a place of its own"


def _folder(name: str, arm: str, source: str, parent: Path = HERE / "sets") -> FieldSet:
    return FieldSet(name, arm, source, lambda: load_dataset(parent / name))


def simulated_ur10(seed: int) -> Dataset:
    """A UR10 with DH parameters and tool off by 0.3 mm and 0.1 deg: 50 training, 500 test poses, 0.05 mm of noise.

    Every tool's model can meet it exactly. Test places are without noise.
    """
    rng = np.random.default_rng([11, seed])
    robot = load_robot(SAMPLES / "ur10_ipa" / "robot.toml")
    table = robot.table[:, :4].copy()
    table[-1] = (60.0, 0.0, 100.0, 0.5)  # off the last axis
    off = rng.standard_normal(table.shape) * [0.3, np.radians(0.1), 0.3, np.radians(0.1)]
    off[-1, 1:2] = 0.0
    q = rng.uniform(-2.5, 2.5, (550, len(table) - 1))
    points = points_of(table + off, q) + 0.05 * rng.standard_normal((550, 3)) * (np.arange(550) < 50)[:, None]
    ids = tuple(f"p{i:03d}" for i in range(550))
    role = np.array(["reference", *["train"] * 49, *["test"] * 500])
    tool = replace(robot.tool, a_mm=60.0, d_mm=100.0, theta_rad=0.5)
    return Dataset(
        f"simulated_{seed}",
        replace(robot, tool=tool),
        Poses(ids, role, q, np.full(550, ""), ids),
        Points(np.arange(550), points, np.full(550, "jig")),
        scanner=Scanner(0.05),
    )


SETS = (
    _folder("ur10_a", "UR10, laser tracker, grid", UR10),
    _folder("ur10_ipa", "UR10, laser tracker, joint configurations", UR10, SAMPLES),
    _folder("ur10_c", "UR10, laser tracker, random poses", UR10),
    _folder("ur10_d", "UR10, laser tracker, cubes of ISO 9283", UR10),
    _folder("jacobi_ur5", "UR5, laser tracker", JACOBI),
    _folder("jacobi_wam", "WAM (cable-driven), laser tracker", JACOBI),
    _folder("mukca_panda_1", SOCKETS, MUKCA),
    _folder("mukca_panda_2_clean", SOCKETS, MUKCA, SAMPLES),
    _folder("mukca_panda_3", SOCKETS, MUKCA),
    _folder("mukca_panda_3_bis", SOCKETS, MUKCA),
    _folder("mukca_panda_6", SOCKETS, MUKCA),
    _folder("mukca_panda_7", SOCKETS, MUKCA),
    *(
        FieldSet(
            f"simulated_{k}", "UR10, simulated, errors of its table alone", "this folder", lambda k=k: simulated_ur10(k)
        )
        for k in range(2)
    ),
)


def problem_of(dataset: Dataset, folder: Path) -> tuple[Problem, Array, str]:
    """Write a problem into a folder; the problem, the places that were measured, and what tells its very numbers."""
    points, poses = dataset.points, dataset.poses
    assert points is not None
    assert np.all(dataset.robot.table[:, 4] == 0.0), "tools of this field know no beta"
    measured, rows = points.xyz_mm, points.pose
    test = poses.is_test[rows]
    shuffled = measured.copy()
    rng = np.random.default_rng(0)
    shuffled[test] = measured[test][rng.permutation(int(test.sum()))]
    problem = Problem(dataset.robot.table[:, :4], poses.q[rows], shuffled, poses.setup[rows].astype(str), test)
    problem.save(folder)
    write_dataset(replace(dataset, points=replace(points, xyz_mm=shuffled)), folder / "dataset")
    digest = hashlib.sha256()
    for part in (problem.table, problem.q, measured, problem.is_test):
        digest.update(np.ascontiguousarray(np.round(part.astype(float), 9)).tobytes())
    return problem, measured, digest.hexdigest()[:16]
