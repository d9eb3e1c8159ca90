"""Cases: what is hidden in which arm, under which noise, and the dataset that an inspector would be handed."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from calib.dataset.dataset import Dataset, Points, Poses, Scanner
from calib.kinematics.robot import Joint, Robot, Target, Tool
from tests.support.engine import joint_causes, law_causes, load_causes, scanner_causes, unforeseen_causes
from tests.support.engine.arms import ArmTable, draw_arm
from tests.support.engine.cause import Cause
from tests.support.engine.cell import TARGETS, Cell, draw_cell
from tests.support.engine.mechanics import Array
from tests.support.engine.noise import draw_noise

Draw = Callable[[Cell, np.random.Generator], Cause]


def _named(module: object, *names: str) -> dict[str, Draw]:
    return {name: getattr(module, name) for name in names}


CATALOGUE = {
    **_named(
        load_causes,
        *("joint_compliance", "link_bending", "gravity_backlash", "base_compliance", "tool_sag"),
        "thermal_growth",
    ),
    **_named(
        joint_causes,
        *("transmission_error", "strain_wave", "joint_scale", "joint_coupling", "backlash", "axis_wobble"),
    ),
    **_named(scanner_causes, "scanner_distortion", "scanner_drift", "incidence_bias"),
}
NEW = {
    **_named(scanner_causes, "joint_step", "target_step", "scanner_step", "warm_up"),
    **_named(joint_causes, "joint_dent", "following_error", "asymmetric_scale", "high_harmonic", "cable_drag"),
    **_named(load_causes, "base_loosening", "nonlinear_stiffness", "link_torsion", "bearing_clearance"),
}
UNFORESEEN = {
    **_named(load_causes, "saturating_spring"),
    **_named(
        unforeseen_causes,
        *("root_of_angle", "creeping_joint", "product_of_joints", "loose_tool", "swinging_payload"),
        *("refraction", "late_clock", "hose_pull", "swaying_tripod", "cyclic_range_error", "creeping_tool"),
        *("unwritten_backlash", "cracked_floor", "steep_coupling"),
    ),
}
CAUSES = {**CATALOGUE, **NEW, **UNFORESEEN, **law_causes.LAW_CAUSES}


@dataclass(frozen=True)
class Case:
    """A case to simulate; its fields are the seed of everything drawn for it."""

    kind: str  # class
    causes: tuple[str, ...]
    number: int
    seed: int = 0
    noise: str = "white"
    sigmas: tuple[float, ...] = ()  # visible size of each cause over the noise; () is drawn, the median 3
    poses: int = 80
    setups: int = 1
    targets: int = 0
    repeats: int = 1
    masses: str = "known"  # unknown, wrong
    twin: bool = False  # the cause is one that another one imitates exactly
    undecidable: bool = False

    @property
    def key(self) -> list[int]:
        words = f"{self.kind} {self.causes} {self.noise} {self.sigmas} {self.poses} {self.masses}"
        return [self.seed, self.number, zlib.crc32(words.encode())]


@dataclass(frozen=True, eq=False)
class Simulated:
    """A dataset and its truth."""

    dataset: Dataset
    cell: Cell
    causes: tuple[tuple[Cause, float], ...]
    sigmas: tuple[float, ...]
    freed_mm: Array = field(repr=False)  # (M, 3) points as they would be measured without the causes


def simulate(case: Case) -> Simulated:
    """Draw arm, poses and causes until every cause can be seen; then measure."""
    rng = np.random.default_rng(case.key)
    for attempt in range(60):
        cell = _cell(case, draw_arm(case.number + attempt * 5, rng), rng)
        sigma_mm = float(np.exp(rng.uniform(np.log(0.02), np.log(0.1))))
        sigmas = case.sigmas or tuple(
            float(np.clip(3.0 * np.exp(0.75 * rng.standard_normal()), 0.5, 15.0)) for _ in case.causes
        )
        causes = []
        for name, sigma in zip(case.causes, sigmas, strict=True):
            cause = _cause(case, name, cell, rng)
            causes.append((cause, cell.size_for(cause, sigma * sigma_mm)))
        if all(np.isfinite(size) and _plausible(cell, cause, size) for cause, size in causes):
            return _measured(case, cell, tuple(causes), sigmas, sigma_mm, rng)
    raise RuntimeError(f"{case}: no arm shows this")


def _cell(case: Case, arm: ArmTable, rng: np.random.Generator) -> Cell:
    loads = any(name in case.causes for name in ("swinging_payload",)) or rng.random() < 0.7
    cell = draw_cell(
        arm,
        rng,
        poses=case.poses,
        setups=case.setups,
        targets=case.targets,
        payload=bool(loads),
        near=case.noise == "growing",
    )
    if case.masses == "wrong":
        cell = replace(cell, mass_factor=rng.choice([0.7, 1.3], arm.n) * rng.uniform(0.9, 1.1, arm.n))
    return cell


def _cause(case: Case, name: str, cell: Cell, rng: np.random.Generator) -> Cause:
    if case.twin:  # of points on one link, these two move them alike
        last = cell.arm.n - 1
        if name == "axis_wobble":
            return joint_causes.axis_wobble(cell, rng, joint=last, order=2)
        return joint_causes.transmission_error(cell, rng, joint=last)
    return CAUSES[name](cell, rng)


def _plausible(cell: Cell, cause: Cause, size: float) -> bool:
    """Whether the tool point moves by less than 40 mm everywhere: what is seen so badly is not told apart."""
    shift = cell.reported([(cause, size)])["jig"] - cell.seen(cell.plain.point)
    return bool(np.linalg.norm(shift, axis=1).max() < 40.0)


def _measured(
    case: Case,
    cell: Cell,
    causes: tuple[tuple[Cause, float], ...],
    sigmas: tuple[float, ...],
    sigma_mm: float,
    rng: np.random.Generator,
) -> Simulated:
    exact, free = cell.reported(causes), cell.reported([])
    pose, xyz, plain, target = [], [], [], []
    for _ in range(case.repeats):
        for name in exact:
            pose.append(np.arange(cell.poses))
            xyz.append(exact[name])
            plain.append(free[name])
            target.append(np.full(cell.poses, name))
    at, points = np.concatenate(pose), np.concatenate(xyz)
    noise = draw_noise(case.noise, points, at, sigma_mm, rng)
    order = np.argsort(at, kind="stable")
    dataset = Dataset(
        name=f"{case.kind} {case.number}",
        robot=robot_of(cell, masses=case.masses != "unknown"),
        poses=_poses(case, cell, rng),
        points=Points(at[order], (points + noise)[order], np.concatenate(target)[order]),
        scanner=Scanner(point_sigma_mm=sigma_mm),
    )
    return Simulated(dataset, cell, causes, sigmas, (np.concatenate(plain) + noise)[order])


def _poses(case: Case, cell: Cell, rng: np.random.Generator) -> Poses:
    n = cell.poses
    role = np.full(n, "train", dtype="<U9")
    role[0] = "reference"
    role[1 + rng.permutation(n - 1)[: round(0.2 * (n - 1))]] = "test"
    needs = set(case.causes)
    time = rng.random() < 0.85 or bool(needs & {"scanner_drift", "warm_up", "rubber_hose"})
    warm = (rng.random() < 0.7 or "thermal_growth" in needs) and "warm_up" not in needs
    written = bool(needs & {"backlash", "side_by_place", "side_by_load"})
    sides = (rng.random() < 0.7 or written) and "unwritten_backlash" not in needs
    return Poses(
        ids=tuple(f"p{k + 1:03d}" for k in range(n)),
        role=role,
        q=cell.q,
        setup=np.array([f"s{s + 1}" for s in cell.setup]) if len(cell.scanner_T_base) > 1 else np.full(n, ""),
        scan_names=tuple(f"p{k + 1:03d}.ply" for k in range(n)),
        payload_kg=cell.payload_kg if np.ptp(cell.payload_kg) > 0 else None,
        temperature_c=cell.temperature_c if warm else None,
        time_s=cell.time_s if time else None,
        approach=cell.approach if sides else None,
    )


def robot_of(cell: Cell, *, masses: bool = True) -> Robot:
    """The arm as its maker's table has it: nominal rows, and masses where they are told."""
    arm = cell.arm
    joints = tuple(
        Joint(
            *row,
            name=f"J{j + 1}",
            type="prismatic" if arm.slides[j] else "revolute",
            min=arm.low[j],
            max=arm.high[j],
            mass_kg=(arm.mass_kg or ())[j] if masses else None,
            com_mm=_vector(arm.com_mm[j]) if masses else None,
            gear_ratio=None if arm.slides[j] else arm.gear,
        )
        for j, row in enumerate(arm.rows[:-1])
    )
    tool = Tool(
        *arm.rows[-1],
        mass_kg=arm.tool_kg if masses else None,
        com_mm=_vector(arm.tool_com_mm) if masses else None,
        payload_com_mm=_vector(arm.payload_com_mm) if masses else None,
    )
    targets = tuple(Target(name, TARGETS[name]) for name in cell.targets)
    return Robot(arm.name, joints, tool, _vector(arm.gravity), targets)


def _vector(values: tuple[float, ...]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z
