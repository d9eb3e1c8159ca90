"""Arms, poses and data that several tests use; independent of `calib.simulation.simulate`."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import Dataset, Orientations, Points, Poses, Scanner
from calib.kinematics.robot import Joint, Robot, Tool

REFERENCE = Path(__file__).parents[1] / "reference"

RB5_CASES = (  # Park, Table 9: what is eliminated
    "aTCP d2 d3 dTCP beta1 beta4 beta5",
    "a6 d2 d3 d6 theta1 theta4 theta5",
    "a6 d2 d4 d6 beta1 theta4 beta5",
    "aTCP d3 d4 dTCP theta1 beta4 theta5",
    "",
)
PANDA_CASES = (  # Park, Table 10
    "a7 d7 theta1 theta2 theta5",
    "a7 dTCP theta1 beta2 beta5",
    "aTCP d7 beta1 theta2 theta5",
    "aTCP dTCP beta1 beta2 beta5",
    "",
)


def _angle(text: str) -> float:
    sign, _, denominator = text.partition("pi")
    if "pi" not in text:
        return float(text)
    return math.copysign(math.pi, -1.0 if sign == "-" else 1.0) / float(denominator.removeprefix("/") or 1)


def park_arm(name: str) -> Robot:
    """ "rb5" or "panda" as Park's Tables 1 and 2 print them."""
    file = {"rb5": "park_table1_rb5.csv", "panda": "park_table2_panda.csv"}[name]
    with (REFERENCE / file).open() as stream:
        rows = [
            (
                float(r["a_mm"]),
                _angle(r["alpha_rad"]),
                float(r["d_mm"]),
                _angle(r["theta_offset_rad"]),
                float(r["beta_rad"]),
            )
            for r in csv.DictReader(stream)
        ]
    joints = tuple(Joint(*row, name=f"J{i + 1}") for i, row in enumerate(rows[:-1]))
    return Robot(name, joints, Tool(*rows[-1]))


def jang_arm(file: str = "jang_table2_rb5_nominal.csv") -> Robot:
    """The RB5-850 of Jang's Tables 2 (nominal) and 3 (calibrated)."""
    with (REFERENCE / file).open() as stream:
        rows = [
            (
                float(r["a_mm"]),
                math.radians(float(r["alpha_deg"])),
                float(r["d_mm"]),
                math.radians(float(r["theta_offset_deg"])),
                math.radians(float(r["beta_deg"])),
            )
            for r in csv.DictReader(stream)
        ]
    return Robot("RB5-850", tuple(Joint(*row, name=f"J{i + 1}") for i, row in enumerate(rows[:-1])), Tool(*rows[-1]))


def random_arm(rng: np.random.Generator, joints: int, *, prismatic: int | None = None) -> Robot:
    """Links of 100-500 mm with axes at right angles or parallel, and a tool off the last axis."""
    rows = [
        Joint(
            a_mm=float(rng.uniform(0, 400)),
            alpha_rad=float(rng.choice([-np.pi / 2, 0.0, np.pi / 2])),
            d_mm=float(rng.uniform(-200, 400)),
            theta_rad=float(rng.uniform(-1, 1)),
            name=f"J{i + 1}",
            type="prismatic" if i == prismatic else "revolute",
        )
        for i in range(joints)
    ]
    tool = Tool(a_mm=float(rng.uniform(30, 80)), d_mm=float(rng.uniform(50, 150)))
    return Robot("random", tuple(rows), tool)


def random_transform(rng: np.random.Generator) -> np.ndarray:
    """(4, 4) any rotation, shifted by about half a metre."""
    out = np.eye(4)
    out[:3, :3] = Rotation.random(rng=rng).as_matrix()
    out[:3, 3] = rng.normal(size=3) * 500.0
    return out


def perturbed(robot: Robot, rng: np.random.Generator, *, mm: float = 1.0, rad: float = 0.003) -> Robot:
    """The arm as it was really made: every entry of the table off by a normal error."""
    return robot.with_table(robot.table + rng.normal(size=robot.table.shape) * np.array([mm, rad, mm, rad, rad]))


def elementary_points(robot: Robot, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tool points (N, 3), mm in the base frame."""
    return elementary_frames(robot, q)[:, -1, :3, 3]


def elementary_frames(robot: Robot, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Base, links and tool (N, n + 2, 4, 4) by elementary transforms, sharing nothing with `calib.kinematics.chain`."""

    def rot(axis: int, angle: float) -> NDArray[np.float64]:
        c, s = math.cos(angle), math.sin(angle)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        out = np.eye(4)
        out[i, i] = out[j, j] = c
        out[i, j], out[j, i] = -s, s
        return out

    def move(x: float, z: float) -> NDArray[np.float64]:
        out = np.eye(4)
        out[0, 3], out[2, 3] = x, z
        return out

    frames = []
    for joints in q:
        at = [np.eye(4)]
        for row, link, value in zip(robot.table, (*robot.joints, None), (*joints, 0.0), strict=True):
            a, alpha, d, theta, beta = row
            turning = link is None or link.is_revolute
            driven = rot(2, theta + (value if turning else 0.0)) @ move(a, d + (0.0 if turning else value))
            at.append(at[-1] @ driven @ rot(0, alpha) @ rot(1, beta))
        frames.append(at)
    return np.array(frames)


def dataset_of(
    nominal: Robot,
    true: Robot,
    rng: np.random.Generator,
    *,
    poses: int = 64,
    test: int = 0,
    noise_mm: float = 0.0,
    sigma_mm: float | None = 0.05,
    base_T_scanner: NDArray[np.float64] | None = None,
    range_rad: float = np.pi,
) -> Dataset:
    """Random poses of the true arm, measured as points in a scanner's frame (the base frame where None)."""
    q = rng.uniform(-range_rad, range_rad, (poses, nominal.n_joints))
    q[:, ~nominal.is_revolute] *= 100.0
    points = elementary_points(true, q)
    if base_T_scanner is not None:
        points = (points - base_T_scanner[:3, 3]) @ base_T_scanner[:3, :3]
    points = points + noise_mm * rng.normal(size=points.shape)
    role = np.array(["reference"] + ["train"] * (poses - 1 - test) + ["test"] * test)
    ids = tuple(f"p{i:04d}" for i in range(poses))
    table = Poses(ids, role, q, np.full(poses, ""), tuple(f"{i}.ply" for i in ids))
    measured = Points(np.arange(poses), points, np.full(poses, "jig"))
    return Dataset("test", nominal, table, measured, scanner=Scanner(sigma_mm))


def flange_dataset_of(
    nominal: Robot,
    true: Robot,
    rng: np.random.Generator,
    *,
    poses: int = 64,
    test: int = 0,
    noise_mm: float = 0.0,
    targets: tuple[str, ...] = ("jig",),
    setups: tuple[str, ...] = ("",),
    full_poses: bool = False,
    q: NDArray[np.float64] | None = None,
) -> Dataset:
    """Random poses of the true arm, which carries the scanner: jigs that stand in the room, seen from the flange.

    Poses have the setups, and the targets, by turns.
    """
    q = rng.uniform(-np.pi, np.pi, (poses, nominal.n_joints)) if q is None else q
    q = np.where(nominal.is_revolute, q, 100.0 * q)
    mounted = np.stack([random_transform(rng) for _ in setups])
    mounted[:, :3, 3] *= 0.2
    stands = np.stack([random_transform(rng) for _ in targets])
    setup, target = np.arange(len(q)) % len(setups), np.arange(len(q)) % len(targets)
    base_T_scanner = elementary_frames(true, q)[:, -2] @ mounted[setup]
    scanner_T_jig = np.linalg.inv(base_T_scanner) @ stands[target]
    points = scanner_T_jig[:, :3, 3] + noise_mm * rng.normal(size=(len(q), 3))
    turns = None
    if full_poses:
        turns = Orientations(scanner_T_jig[:, :3, :3], np.broadcast_to(1e-8 * np.eye(3), (len(q), 3, 3)))
    role = np.array(["reference"] + ["train"] * (len(q) - 1 - test) + ["test"] * test)
    ids = tuple(f"p{i:04d}" for i in range(len(q)))
    table = Poses(ids, role, q, np.array(setups)[setup], tuple(f"{i}.ply" for i in ids))
    measured = Points(np.arange(len(q)), points, np.array(targets)[target], orientations=turns)
    robot = replace(nominal, carries_scanner=True)
    return Dataset("test", robot, table, measured, scanner=Scanner(max(noise_mm, 1e-3)))
