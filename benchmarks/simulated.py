"""Arms and simulated measurements that several benchmarks share. Not a script.

What a true arm does comes from `calib.simulation.truth.equilibrium`, which shares nothing with the kinematics that a
fit uses.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from calib import frames  # noqa: E402
from calib.array_types import Array  # noqa: E402
from calib.dataset.dataset import Dataset, Points, Poses, Scanner  # noqa: E402
from calib.dataset.files.robot_toml import builtin_robot  # noqa: E402
from calib.kinematics.robot import Joint, Robot, Tool  # noqa: E402
from calib.simulation.truth.equilibrium import Truth, scanner_T_target  # noqa: E402
from tests.support.arms import park_arm, random_arm  # noqa: E402

RIGHT = np.pi / 2
NOISE_MM = 0.05


def ur10(tool: Tool) -> Robot:
    """Universal Robots UR10: the maker's DH table, joints 2, 3 and 4 parallel."""
    rows = [
        (0.0, RIGHT, 127.3, 0.0),
        (-612.0, 0.0, 0.0, 0.0),
        (-572.3, 0.0, 0.0, 0.0),
        (0.0, RIGHT, 163.941, 0.0),
        (0.0, -RIGHT, 115.7, 0.0),
        (0.0, 0.0, 92.2, 0.0),
    ]
    joints = tuple(Joint(*row, name=f"J{i + 1}") for i, row in enumerate(rows))
    return Robot("UR10", joints, tool)


def ur10e() -> Robot:
    """Universal Robots UR10e: the maker's DH table and masses, and a jig off the flange's axis."""
    lengths_mm = [(0.0, 180.7), (-612.7, 0.0), (-571.55, 0.0), (0.0, 174.15), (0.0, 119.85), (0.0, 116.55)]
    masses_kg = [7.369, 13.051, 3.989, 2.1, 1.98, 0.615]
    com_mm = [
        (21.0, 0.0, 27.0),
        (380.0, 0.0, 158.0),
        (240.0, 0.0, 68.0),
        *[(0.0, 7.0, 18.0)] * 2,
        (0.0, 0.0, -26.0),
    ]
    old = ur10(Tool(a_mm=40.0, d_mm=88.0))
    joints = tuple(
        replace(joint, a_mm=a, d_mm=d, mass_kg=kg, com_mm=com)
        for joint, (a, d), kg, com in zip(old.joints, lengths_mm, masses_kg, com_mm, strict=True)
    )
    return replace(old, name="UR10e", joints=joints)


def scara() -> Robot:
    """Two parallel turns, a slide and a turn: a 600 mm SCARA with a tool off its last axis."""
    rows = [(325.0, 0.0, 400.0, 0.0), (275.0, np.pi, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 50.0, 0.0)]
    joints = tuple(
        Joint(*row, name=f"J{i + 1}", type="prismatic" if i == 2 else "revolute") for i, row in enumerate(rows)
    )
    return Robot("SCARA", joints, Tool(a_mm=40.0, d_mm=80.0))


def mixed_arm(index: int, rng: np.random.Generator) -> tuple[str, Robot]:
    """Arm of a mixture: Park's RB5, Park's Panda, random arms of 5, 6 and 7 joints, in turn."""
    kinds = ("rb5", "panda", "random 5", "random 6", "random 7")
    kind = kinds[index % len(kinds)]
    return kind, random_arm(rng, int(kind[-1])) if kind.startswith("random") else park_arm(kind)


def heavy_arm(index: int, rng: np.random.Generator) -> tuple[str, Robot]:
    """Arm of a mixture with masses: the builtin RB5 and Panda, random arms of 12 kg at the root to 1 kg at the tip."""
    kinds = ("rb5", "panda", "random 5", "random 6", "random 7")
    kind = kinds[index % len(kinds)]
    if not kind.startswith("random"):
        return kind, builtin_robot(kind)
    robot = random_arm(rng, int(kind[-1]))
    masses = np.geomspace(12.0, 1.0, robot.n_joints)
    joints = tuple(
        replace(joint, mass_kg=float(mass), com_mm=(-0.5 * joint.a_mm, 0.0, float(rng.uniform(-50, 50))))
        for joint, mass in zip(robot.joints, masses, strict=True)
    )
    return kind, replace(robot, joints=joints)


def off_by(robot: Robot, rng: np.random.Generator, *, mm: float, rad: float) -> Robot:
    """The arm as it was made: every entry of the table off by a normal error."""
    return robot.with_table(robot.table + rng.standard_normal(robot.table.shape) * np.array([mm, rad, mm, rad, rad]))


def anywhere(rng: np.random.Generator) -> Array:
    """A scanner's place (4, 4): any orientation, a metre or so away."""
    turn = frames.rotation_from_rotvec(rng.uniform(0.0, np.pi) * unit(rng.standard_normal(3)))
    return frames.make_transform(turn, rng.normal(0.0, 1000.0, 3))


def unit(vector: Array) -> Array:
    """The vector's direction."""
    return np.asarray(vector / np.linalg.norm(vector))


def rms_3d(error_mm: Array) -> float:
    """RMS length of errors (..., 3)."""
    return float(np.sqrt(np.mean(np.sum(error_mm**2, axis=-1))))


def random_q(robot: Robot, count: int, rng: np.random.Generator) -> Array:
    """(count, n) all over: half a turn either way, 300 mm either way for a slide."""
    return rng.uniform(-1.0, 1.0, (count, robot.n_joints)) * np.where(robot.is_revolute, np.pi, 300.0)


def measured(
    nominal: Robot, truth: Truth, q: Array, rng: np.random.Generator, *, noise_mm: float, test: int = 0
) -> Dataset:
    """The truth's tool point at poses q (N, n), in the scanner's frame; the last `test` poses have the role test."""
    count = len(q)
    ids = tuple(f"p{i:06d}" for i in range(count))
    role = np.array(["reference"] + ["train"] * (count - 1 - test) + ["test"] * test)
    poses = Poses(ids, role, q, np.full(count, ""), ids)
    points = scanner_T_target(truth, q)[:, :3, 3] + noise_mm * rng.standard_normal((count, 3))
    return Dataset(
        "simulated",
        nominal,
        poses,
        Points(np.arange(count), points, np.full(count, "jig")),
        scanner=Scanner(NOISE_MM),
    )
