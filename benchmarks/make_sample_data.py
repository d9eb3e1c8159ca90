"""Make sample_data/ and the truth its tests compare with, from seeds.

    python benchmarks/make_sample_data.py [NAME ...]

Without names all are made. The same numpy, scipy and Open3D write the same bytes again; others differ in the last
digits. Where the datasets come from and what is hidden in them stands in sample_data/README.md.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from calib.array_types import Array
from calib.dataset.dataset import Poses
from calib.dataset.files.robot_toml import builtin_robot
from calib.errors import CalibError
from calib.frames import apply
from calib.kinematics.chain import nominal_chain
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot
from calib.simulation.pose_design import (
    MAX_TILT_DEG,
    draw_scanner_pose,
    scan_poses,
    spread_poses,
    usable_poses,
)
from calib.simulation.scanner import CUBE_CORNER, STRUCTURED_LIGHT
from calib.simulation.simulate import Simulation, measure, rounded, simulate_dataset, write_simulation
from calib.simulation.truth.arm_sampling import draw_truth
from calib.simulation.truth.equilibrium import Truth, scanner_T_target
from calib.simulation.truth.load_effects import JointCompliance
from calib.workcell.scan_field import tilted

ROOT = Path(__file__).resolve().parents[1]

JANG_SEED, REPEATS_SEED = 3, 11
HIDDEN_SEEDS = {"hidden_effect_a": 31, "hidden_effect_b": 32, "hidden_effect_c": 33}

# What is hidden, and how large: visible rms a coordinate, in sigmas of the noise (calib.simulation.truth.sampling).
HIDDEN: dict[str, tuple[str, tuple[tuple[str, float], ...]]] = {
    "hidden_effect_a": ("rb5", (("transmission_error", 4.0),)),
    "hidden_effect_b": ("panda", (("joint_compliance", 5.0), ("backlash", 3.0))),
    "hidden_effect_c": ("rb5", (("joint_step", 4.0),)),
}

# Harmonic drives of this size: shoulder about 8e4 Nm/rad, wrist about 2e4 Nm/rad.
COMPLIANCE_RAD_PER_NM = (1.2e-5, 1.4e-5, 1.8e-5, 4.8e-5, 5.4e-5, 6.6e-5)

# Jang 2025, Table 1: where the apex stands at the four points, scanner frame, mm.
JANG_POINTS_MM = {
    "P1": (-73.6937, 42.9056, 661.386),
    "P2": (105.390, 46.8749, 689.947),
    "P3": (134.837, -16.3709, 748.842),
    "P4": (-93.4269, 21.2656, 593.549),
}

SCANS = replace(STRUCTURED_LIGHT, points=9_000)


def rb5_jang(robot: Robot) -> Simulation:
    """Jang's experiment: training in two configurations of the arm, testing in all that it has."""
    rng = np.random.default_rng(JANG_SEED)
    base_T_scanner = draw_scanner_pose(robot, rng=rng)
    configurations = scan_poses(robot, base_T_scanner, 2, rng=rng)
    candidates = scan_poses(robot, base_T_scanner, 102, rng=rng, start_q=configurations)
    training = candidates[spread_poses(candidates, 51)]
    testing = scan_poses(robot, base_T_scanner, 13, rng=rng)
    q = rounded(robot, np.concatenate([training, testing]))
    truth = draw_truth(robot, base_T_scanner, q, rng=rng)
    truth = truth.with_effects(JointCompliance(np.array(COMPLIANCE_RAD_PER_NM)))
    ids = tuple(f"p{i + 1:02d}" for i in range(len(q)))
    poses = Poses(
        ids=ids,
        role=np.array(["reference"] + 50 * ["train"] + 13 * ["test"]),
        q=q,
        setup=np.full(len(q), ""),
        scan_names=tuple(f"{pose_id}.ply" for pose_id in ids),
    )
    return measure(
        robot,
        truth,
        poses,
        rng=rng,
        name="rb5_jang",
        description="Simulated RB5-850 after Jang 2025: 64 scans of the jig, 50 poses to train on and 13 to test",
        scan_model=SCANS,
    )


def reach_apexes(robot: Robot, base_T_scanner: Array, apex_mm: Array, *, rng: np.random.Generator) -> Array:
    """Joint vectors (K, n) that bring the jig's apex to places (K, 3), scanner frame, as `scan_poses` holds it."""
    poses = []
    for goal_mm in apex_mm:
        for _ in range(12):
            apexes = np.tile(goal_mm, (256, 1))
            axis = tilted(apexes / np.linalg.norm(apexes, axis=1, keepdims=True), MAX_TILT_DEG, rng)
            start = random_poses(robot, 256, rng=rng)
            q = usable_poses(robot, base_T_scanner, apexes, axis, start, CUBE_CORNER)
            if len(q):
                poses.append(q[0])
                break
        else:
            raise CalibError(f"robot {robot.name}: cannot hold the jig at {goal_mm} mm of the scanner")
    return np.array(poses)


def rb5_repeats(robot: Robot, truth: Truth) -> Simulation:
    """Jang's Table 1: the same arm stands still at four points, ten scans at each."""
    rng = np.random.default_rng(REPEATS_SEED)
    wanted_mm = np.array(list(JANG_POINTS_MM.values()))
    q = reach_apexes(robot, truth.base_T_scanner, wanted_mm, rng=rng)
    q = np.radians(np.round(np.degrees(led_to(truth, q, wanted_mm)), 7))
    rows = [(point, cycle + 1) for point in JANG_POINTS_MM for cycle in range(10)]
    ids = tuple(f"{point}_{cycle:02d}" for point, cycle in rows)
    poses = Poses(
        ids=ids,
        role=np.array(["reference"] + (len(rows) - 1) * ["train"]),
        q=np.repeat(q, 10, axis=0),
        setup=np.full(len(rows), ""),
        scan_names=tuple(f"{pose_id}.ply" for pose_id in ids),
        extra=pd.DataFrame(rows, columns=["point", "cycle"]),
    )
    return measure(
        robot,
        truth,
        poses,
        rng=rng,
        name="rb5_repeats",
        description="Simulated RB5-850 after Jang 2025, Table 1: four points, ten scans each, the arm stands still",
        scan_model=SCANS,
    )


def hidden_effect(name: str) -> Simulation:
    """Points of an arm with something wrong: all conditions vary and are written down, whatever the cause."""
    arm, effects = HIDDEN[name]
    robot = builtin_robot(arm)
    return simulate_dataset(
        robot,
        rng=np.random.default_rng(HIDDEN_SEEDS[name]),
        effects=effects,
        conditions=True,
        name=name,
        description=f"Simulated {robot.name}: 64 measured points, 50 poses to train on and 13 to test",
    )


def led_to(truth: Truth, q: np.ndarray, wanted_mm: np.ndarray) -> np.ndarray:
    """Joint vectors (K, n) near q at which the true apex stands at `wanted_mm` (K, 3), scanner frame, to 1e-9 mm."""
    robot = truth.robot
    base_mm = apply(truth.base_T_scanner, wanted_mm)
    for _ in range(10):
        off_mm = base_mm - apply(truth.base_T_scanner, scanner_T_target(truth, q)[:, :3, 3])
        chain = nominal_chain(robot, q)
        axis, origin_mm = chain.base_T_frame[:, :-2, :3, 2], chain.base_T_frame[:, :-2, :3, 3]
        move = np.swapaxes(np.cross(axis, chain.target_mm[:, None] - origin_mm), 1, 2)  # (K, 3, n)
        q = q + np.einsum("knj,kj->kn", np.linalg.pinv(move), off_mm)
    return q


def main(names: Sequence[str]) -> None:
    """Write the named datasets and their truth anew."""
    robot = builtin_robot("rb5")
    jang = rb5_jang(robot)
    makers: dict[str, Callable[[], Simulation]] = {
        "rb5_jang": lambda: jang,
        "rb5_repeats": lambda: rb5_repeats(robot, jang.truth),
        **{name: partial(hidden_effect, name) for name in HIDDEN},
    }
    for name in names or makers:
        if name not in makers:
            sys.exit(f"{name}: none of {', '.join(makers)}")
        simulation = makers[name]()
        folder = ROOT / "sample_data" / name
        shutil.rmtree(folder, ignore_errors=True)
        write_simulation(simulation, folder, truth_path=ROOT / "tests" / "truth" / f"{name}.json")
        size_mb = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6
        print(
            f"{folder.relative_to(ROOT)}: {len(simulation.dataset.poses)} poses, {size_mb:.1f} MB",
            file=sys.stderr,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
