"""Arms in a cell with a table and a post, and the same cells in MuJoCo, to check poses called measurable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.dataset.dataset import Box
from calib.dataset.files.robot_toml import builtin_robot
from calib.frames import make_transform
from calib.kinematics.robot import Joint, Robot, Tool
from calib.workcell.bodies.arm_bodies import FIXED
from calib.workcell.workcell import Workcell
from tests.support.engine.arms import GANTRY, UR10E, ArmTable
from tests.support.mujoco_cell import JIG, MujocoCell, Rod

BOXES = (
    Box("table", (-300.0, -900.0, -200.0), (250.0, -350.0, 350.0)),
    Box("post", (700.0, 300.0, -500.0), (800.0, 400.0, 900.0)),
)


def robot_of(arm: ArmTable) -> Robot:
    joints = [
        Joint(*row, name=f"J{i + 1}", type="prismatic" if slides else "revolute", min=low, max=high)
        for i, (row, slides, low, high) in enumerate(zip(arm.rows[:-1], arm.slides, arm.low, arm.high, strict=True))
    ]
    return Robot(arm.name, tuple(joints), Tool(*arm.rows[-1]))


ARMS = {
    "rb5": builtin_robot("rb5"),
    "panda": builtin_robot("panda"),
    "UR10e": robot_of(UR10E),
    "gantry": robot_of(GANTRY),
}


def in_mujoco(cell: Workcell) -> tuple[MujocoCell, list[tuple[str, str]]]:
    """The cell in MuJoCo with bodies of the same radii, and the names of those that must not meet."""
    bodies, rods, names = cell.bodies, [], []
    for k in range(len(bodies)):
        if not bodies.hides[k]:
            names.append(JIG)
            continue
        if bodies.piece[k] == FIXED:
            ends = tuple(bodies.start_mm[k]), tuple(bodies.end_mm[k])
            names.append("tool")
            rods.append(Rod("tool", int(bodies.link[k]), float(bodies.radius_mm[k]), "points", 20.0, *ends))
            continue
        along = "da"[bodies.piece[k]]
        names.append(f"{bodies.link[k]}{along}")
        rods.append(
            Rod(
                names[-1],
                int(bodies.link[k]),
                float(bodies.radius_mm[k]),
                along,
                float(bodies.shortened_mm[k]),
            )
        )
    there = MujocoCell(cell.robot, rods, floor_z_mm=cell.floor_z_mm, boxes=cell.boxes)
    around = [box.name for box in cell.boxes] + (["floor"] if cell.floor_z_mm is not None else [])
    pairs = [(names[i], names[j]) for i, j in bodies.pairs]
    pairs += [(name, thing) for name in (*(rod.name for rod in rods), JIG) for thing in around if name != "0d"]
    return there, pairs


def is_fine(there: MujocoCell, pairs: list[tuple[str, str]], q: NDArray, eye_mm: NDArray) -> bool:
    there.stand(q)
    if there.steepest_deg(eye_mm) > 70.0 or there.hidden(eye_mm):
        return False
    return not any(there.meet(*pair) for pair in pairs)


def looking_from(cell: Workcell, rng: np.random.Generator) -> Workcell:
    """The cell with the scanner anywhere, so that arm and boxes are often in its line of sight."""
    q = rng.uniform(cell.low, cell.high, (200, len(cell.low)))
    z, other = rng.normal(size=(2, 3))
    z /= np.linalg.norm(z)
    x = np.cross(z, other) / np.linalg.norm(np.cross(z, other))
    middle = np.median(cell.chain(q).target_mm, axis=0) + rng.uniform(-300.0, 300.0, 3)
    turn = np.column_stack([x, np.cross(z, x), z])
    return replace(cell, base_T_scanner=make_transform(turn, middle - 700.0 * z))
