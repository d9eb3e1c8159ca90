"""Cells of `tests.support.engine` measured again at each pose: under a weight, from the other side, warm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import calibrate
from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.dataset.files.robot_toml import builtin_robot
from calib.intervention.proof import Proof, interventions_of
from calib.statistics import rms
from tests.support.engine.arms import RB5, UR10E, ArmTable
from tests.support.engine.cases import robot_of
from tests.support.engine.cause import Cause
from tests.support.engine.cell import Cell, draw_cell
from tests.support.engine.load_causes import bent_rod
from tests.support.engine.mechanics import Array, Deformation, Posture

SHORT_MM = 100.0  # a shorter link does not bend
LARGEST = {"joint_compliance": 1e-3, "link_bending": 1e-4, "base_compliance": 1e-4}
"""rad/Nm, that a part of a real arm yields by at the most."""


def panda() -> ArmTable:
    """The builtin Panda as the engine has arms."""
    robot = builtin_robot("panda")
    tool = (40.0, 0.0, 120.0, 0.0, 0.0)
    return ArmTable(
        name="Panda",
        rows=(*(tuple(joint.row) for joint in robot.joints), tool),
        slides=(False,) * robot.n_joints,
        low=tuple(float(joint.min or 0.0) for joint in robot.joints),
        high=tuple(float(joint.max or 0.0) for joint in robot.joints),
        mass_kg=tuple(float(joint.mass_kg or 0.0) for joint in robot.joints),
        com_mm=tuple(tuple(joint.com_mm or (0.0, 0.0, 0.0)) for joint in robot.joints),
        tool_kg=0.6,
        tool_com_mm=(15.0, 5.0, 50.0),
        payload_com_mm=(30.0, -20.0, 90.0),
        payloads_kg=(0.0, 2.0),
    )


ARMS = {"RB5": RB5, "UR10e": UR10E, "Panda": panda()}


@dataclass(frozen=True)
class Member:
    """One part that gives way to the load, as calib names it: effect and joint, counted from 1."""

    effect: str
    joint: int | None
    cause: Cause


def compliance(joint: int) -> Member:
    """A joint that yields by 1e-6 rad/Nm times its size."""

    def deform(cell: Cell, here: Posture, size: float) -> Deformation:
        turned = np.zeros_like(cell.q)
        turned[:, joint] = size * 1e-6 * here.load(joint, cell.arm.slides[joint])
        return replace(cell.stiff, joint=turned)

    return Member("joint_compliance", joint + 1, Cause("joint_compliance", deform))


def bending(link: int) -> Member:
    """A link that bends, L / EI being 1e-6 rad/Nm times its size."""

    def deform(cell: Cell, here: Posture, size: float) -> Deformation:
        turn, shift = np.zeros((cell.poses, cell.arm.n, 3)), np.zeros((cell.poses, cell.arm.n, 3))
        by_axes, by_shift = bent_rod(cell, here, link)
        turn[:, link], shift[:, link] = size * 1e-6 * by_axes, size * 1e-6 * by_shift
        return replace(cell.stiff, turn=turn, shift=shift)

    return Member("link_bending", link + 1, Cause("link_bending", deform))


def base(soft: Sequence[float]) -> Member:
    """A pedestal that tilts by 1e-6 rad/Nm times its size and the given shares about x and y."""

    def deform(cell: Cell, here: Posture, size: float) -> Deformation:
        moment = here.moment(np.zeros((cell.poses, 3)), 0)
        return replace(cell.stiff, base_turn=size * 1e-6 * np.array([*soft, 0.0]) * moment)

    return Member("base_compliance", None, Cause("base_compliance", deform))


def members_of(arm: ArmTable) -> list[Member]:
    """Every joint and every long link that may give way; the pedestal apart, and the last link, which is the tool's."""
    rods = np.hypot(*np.array(arm.rows)[:-2, [0, 2]].T)
    return [compliance(j) for j in range(arm.n)] + [bending(j) for j in range(arm.n - 1) if rods[j] > SHORT_MM]


def draw_pairs(
    arm: ArmTable, rng: np.random.Generator, places: int = 20, loads_kg: Sequence[float] = (0.0, 2.0)
) -> Cell:
    """A cell whose poses are measured in one run for each load, at the same joints."""
    cell = draw_cell(arm, rng, poses=places, payload=False)
    runs = len(loads_kg)
    return replace(
        cell,
        q=np.tile(cell.q, (runs, 1)),
        payload_kg=np.repeat(np.array(loads_kg, dtype=float), places),
        temperature_c=np.full(runs * places, 22.0),
        time_s=30.0 * np.arange(runs * places),
        approach=np.tile(cell.approach, (runs, 1)),
        setup=np.zeros(runs * places, dtype=np.int64),
    )


def with_joints_held(cell: Cell, at_rad: Sequence[float]) -> Cell:
    """The cell with its last joints held at some angles."""
    q = cell.q.copy()
    q[:, -len(at_rad) :] = at_rad
    return replace(cell, q=q)


def places_of(cell: Cell) -> int:
    """Number of joint vectors, each measured in every run."""
    return len(np.unique(cell.q, axis=0))


def difference_mm(cell: Cell, causes: Sequence[tuple[Cause, float]]) -> Array:
    """What causes add to the last run's points less the first's, (places, 3) mm."""
    seen = cell.reported(causes)["jig"] - cell.reported([])["jig"]
    places = places_of(cell)
    return np.asarray(seen[-places:] - seen[:places])


def size_of(cell: Cell, cause: Cause, rms_mm: float) -> float:
    """Size at which a cause's differences have a root mean square a coordinate."""
    return rms_mm / rms(difference_mm(cell, [(cause, 1.0)]))


def measured(
    cell: Cell,
    causes: Sequence[tuple[Cause, float]],
    rng: np.random.Generator,
    *,
    noise_mm: float = 0.05,
    test_places: int = 0,
    masses: bool = True,
) -> Dataset:
    """Dataset of one noisy point a pose; the last places are of test poses."""
    count = cell.poses
    places = places_of(cell)
    held_out = np.arange(count) % places >= places - test_places
    role = np.where(held_out, "test", "train").astype("<U9")
    role[0] = "reference"
    poses = Poses(
        ids=tuple(f"p{i % places + 1:02}_run{i // places + 1}" for i in range(count)),
        role=role,
        q=cell.q,
        setup=np.full(count, ""),
        scan_names=tuple(f"{i}.ply" for i in range(count)),
        payload_kg=cell.payload_kg if np.ptp(cell.payload_kg) > 0.0 else None,
        temperature_c=cell.temperature_c if np.ptp(cell.temperature_c) > 0.0 else None,
        approach=cell.approach if np.ptp(cell.approach[::places], axis=0).any() else None,
    )
    xyz_mm = cell.reported(causes)["jig"] + noise_mm * rng.standard_normal((count, 3))
    points = Points(np.arange(count), xyz_mm, np.full(count, "jig"))
    robot = robot_of(cell, masses=masses)
    return Dataset("pairs", robot, poses, points, scanner=Scanner(point_sigma_mm=noise_mm))


def proofs_of(dataset: Dataset) -> tuple[Proof, ...]:
    """Causes that the paired poses of a dataset prove, after a fit of its links."""
    return tuple(proof for one in interventions_of(calibrate(dataset)) for proof in one.proofs)
