"""Whole datasets with known truth: an arm with link errors and effects, its poses, its points or scans; also as files.

The arm's errors are drawn in `calib.simulation.truth.arm_sampling`, its poses in `calib.simulation.pose_design`. The
true positions follow from `calib.simulation.truth.equilibrium`.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.brief import Brief
from calib.dataset.dataset import Dataset, Orientations, Points, Poses, Scanner
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.folder import write_dataset
from calib.errors import CalibError
from calib.jig import Jig
from calib.kinematics.joint_range import random_poses
from calib.kinematics.robot import Robot
from calib.kinematics.tool_point import ending_at_tool_point
from calib.progress import OnProgress, counted
from calib.robot_formats.robots import load_robot
from calib.scans.scan import write_scan
from calib.simulation.pose_design import (
    draw_flange_mount,
    draw_jig_in_view,
    draw_jig_place,
    draw_scanner_pose,
    draw_setups,
    facing_poses,
    scan_poses,
    spread_poses,
)
from calib.simulation.scanner import CUBE_CORNER, STRUCTURED_LIGHT, ScanModel, SimulatedScan, simulate_scan
from calib.simulation.truth.arm_sampling import (
    SIMULATED,
    TYPICAL,
    EffectRequest,
    Tolerances,
    check_effects,
    draw_truth,
    effect_name,
)
from calib.simulation.truth.equilibrium import Truth, scanner_T_target, truth_document
from calib.simulation.truth.mechanism import Conditions
from calib.simulation.truth.sampling import SimulatedCell
from calib.workcell.jig_on_tool import JIG_HEIGHT_MM, target_T_jig, with_jig

_WINDOW_RASTER_MM = 30.0


@dataclass(frozen=True)
class Simulation(Brief):
    """A dataset with its known truth; `scan` simulates a pose's scan on demand, with a seed of its own."""

    dataset: Dataset
    truth: Truth
    apex_mm: Array  # (N, 3) measured point without noise, scanner frame
    scanner_T_jig: Array  # (N, 4, 4)
    scan_model: ScanModel | None
    scan_seeds: tuple[int, ...]

    def scan(self, pose: int) -> SimulatedScan:
        """Simulated scan of one pose; repeated calls give the same points."""
        if self.scan_model is None:
            raise CalibError(f"dataset {self.dataset.name}: simulated as points; ask for scans when simulating")
        # Rounded to a raster over the field, so that repeated scans of a pose have the same window.
        apex_mm = self.apex_mm[pose, :2]
        on_plate = self.truth.base_T_jig is not None
        offset_mm = _WINDOW_RASTER_MM * np.round(apex_mm / _WINDOW_RASTER_MM) - apex_mm
        return simulate_scan(
            self.scanner_T_jig[pose],
            self.dataset.jig,
            rng=np.random.default_rng(self.scan_seeds[pose]),
            name=self.dataset.poses.ids[pose],
            model=self.scan_model,
            flange_mm=JIG_HEIGHT_MM if on_plate else abs(self.dataset.robot.tool.d_mm),
            arm_turn_rad=float(-self.dataset.poses.q[pose, -1]),
            on_plate=on_plate,
            window_offset_mm=(float(offset_mm[0]), float(offset_mm[1])),
        )

    def document(self) -> dict[str, Any]:
        """Content of truth.json as a dict."""
        poses = self.dataset.poses
        cell = SimulatedCell(self.dataset.robot, self.truth.with_effects(), poses.q, Conditions.of(poses))
        visible = {effect.name: cell.visible_rms_mm(effect) for effect in self.truth.effects if not effect.is_absent}
        document = truth_document(self.truth, self.dataset.robot) | {
            "visible_rms_mm": visible,
            "dataset": self.dataset.name,
            "apex_mm": dict(zip(poses.ids, self.apex_mm.tolist(), strict=True)),
        }
        return document if self.scan_model is None else document | {"scanner_errors": asdict(self.scan_model)}


def measure(
    robot: Robot,
    truth: Truth,
    poses: Poses,
    *,
    rng: np.random.Generator,
    name: str,
    description: str = "",
    jig: Jig = CUBE_CORNER,
    noise_mm: float | None = None,
    scan_model: ScanModel | None = None,
    repeats: int = 1,
    orientation_sigma_rad: float | None = None,
) -> Simulation:
    """Simulated measurement of an arm at given poses: points where `noise_mm` is given, scans where `scan_model` is.

    The points are full poses of the jig where `orientation_sigma_rad` is given.
    """
    scanner_T_tool = scanner_T_target(truth, poses.q, Conditions.of(poses))
    scanner_T_jig = scanner_T_tool if truth.base_T_jig is not None else scanner_T_tool @ target_T_jig(robot)
    apex_mm = scanner_T_tool[:, :3, 3]
    points = None
    if noise_mm is not None:
        pose = np.repeat(np.arange(len(poses)), repeats)
        noisy_mm = apex_mm[pose] + noise_mm * rng.standard_normal((len(pose), 3))
        points = Points(pose=pose, xyz_mm=noisy_mm, target=np.full(len(pose), "jig"))
        if orientation_sigma_rad is not None:
            turned = Rotation.from_rotvec(orientation_sigma_rad * rng.standard_normal((len(pose), 3)))
            scanner_R_jig = scanner_T_jig[pose, :3, :3]
            orientations = Orientations((turned * Rotation.from_matrix(scanner_R_jig)).as_matrix())
            points = replace(points, orientations=orientations)
    dataset = Dataset(
        name=name,
        description=description,
        robot=robot,
        poses=poses,
        points=points,
        scan_folder=None if scan_model is None else "scans",
        scanner=_declared_noise(noise_mm, scan_model, orientation_sigma_rad),
        jig=jig,
    )
    seeds = tuple(int(seed) for seed in rng.integers(2**63, size=len(poses))) if scan_model is not None else ()
    return Simulation(dataset, truth, apex_mm, scanner_T_jig, scan_model, seeds)


def _declared_noise(noise_mm: float | None, model: ScanModel | None, orientation_sigma_rad: float | None) -> Scanner:
    """Scanner errors as declared in dataset.toml: their sizes, and the correlation length of the smooth part."""
    scanner = Scanner(point_sigma_mm=noise_mm or None, orientation_sigma_rad=orientation_sigma_rad or None)
    if model is None:
        return scanner
    scanner = replace(scanner, scan_sigma_mm=model.scan_sigma_mm or None)
    if model.correlated_sigma_mm > 0:
        scanner = replace(
            scanner, correlated_sigma_mm=model.correlated_sigma_mm, correlation_length_mm=model.correlation_length_mm
        )
    return scanner


def write_simulation(
    simulation: Simulation,
    folder: Path,
    *,
    truth_path: Path | None = None,
    progress: bool = False,
    on_progress: OnProgress | None = None,
) -> None:
    """Write the dataset's folder, its scans, and the truth (truth.json in the folder unless `truth_path` is given).

    `progress` shows a bar while scans are made, in a notebook's cell or at the terminal.
    """
    folder = Path(folder)
    poses = simulation.dataset.poses
    if simulation.scan_model is not None:
        scan_folder = folder / (simulation.dataset.scan_folder or "scans")
        scan_folder.mkdir(parents=True, exist_ok=True)
        with counted("scans", "scan", asked=progress, then=on_progress) as tell:
            for i, scan_name in enumerate(poses.scan_names):
                write_scan(scan_folder / scan_name, simulation.scan(i).scan)
                if tell is not None:
                    tell(i + 1, len(poses), poses.ids[i])
    write_dataset(simulation.dataset, folder)
    truth_path = folder / "truth.json" if truth_path is None else truth_path
    truth_path.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(truth_path, json.dumps(simulation.document(), indent=1) + "\n")


PAYLOADS_KG = (0.0, 1.0, 2.5)


def draw_conditions(robot: Robot, count: int, *, rng: np.random.Generator) -> Conditions:
    """Random conditions of `count` consecutive poses: every column of poses.csv except the setup.

    A pose takes 25 to 60 s. The cell warms up by about 10 K in the first hour or so and swings by 2 K with the
    air conditioning, so that temperature and time are not confounded. Joints come from either side at random.
    """
    time_s = np.asarray(np.round(np.cumsum(np.append(0.0, rng.uniform(25.0, 60.0, count - 1))), 1), dtype=float)
    swing = np.sin(2.0 * np.pi * (time_s / rng.uniform(900.0, 1500.0) + rng.random()))
    warming = 1.0 - np.exp(-time_s / rng.uniform(1200.0, 2400.0))
    temperature_c = 20.0 + rng.uniform(9.0, 12.0) * warming + rng.uniform(1.5, 2.5) * swing
    return Conditions(
        payload_kg=rng.choice(np.array(PAYLOADS_KG), count),
        temperature_c=np.round(temperature_c, 2),
        time_s=time_s,
        approach=rng.choice(np.array([-1.0, 1.0]), (count, robot.n_joints)),
    )


def simulate_dataset(
    robot: Robot | str | Path,
    *,
    rng: np.random.Generator | int,
    effects: Sequence[EffectRequest] = (),
    visible_sigmas: float | None = None,
    conditions: bool | None = None,
    poses: int = 64,
    noise_mm: float = 0.05,
    scans: bool = False,
    name: str = "simulated",
    description: str = "",
    jig: Jig = CUBE_CORNER,
    tolerances: Tolerances = TYPICAL,
    scan_model: ScanModel = STRUCTURED_LIGHT,
    payloads_kg: Sequence[float] = (),
    every_payload: bool = False,
    repeats: int = 1,
    setups: int = 1,
    orientation_sigma_rad: float | None = None,
) -> Simulation:
    """A simulated dataset of an arm near the given nominal robot, with the known truth.

    Where the arm carries the scanner, the scanner is on the flange and the jig stands in front of the arm.

    Args:
        robot: a robot, its file, or the name of a built-in one.
        rng: generator of all that is drawn, or a seed of one.
        effects: of the true arm, each by name (`SIMULATED_EFFECTS`, `OUTSIDE_EFFECTS`), as (name, visible magnitude in
            noise sigmas), or with all parameters; the rest is drawn.
        visible_sigmas: visible magnitude of effects given by name alone; None: each moves the point by 0.2 to 0.5 mm.
        conditions: payload, temperature, time and approach vary and are columns of poses.csv; None: where an effect
            needs them.
        poses: their number; one is the reference, the others are split 50 : 13 into train and test (Jang 2025).
        noise_mm: standard deviation of a measured point along each axis; scans have that of `scan_model` instead.
        scans: poses keep the jig in the scanner's field, and scans are cast. Otherwise points over the work space.
        payloads_kg: each pose carries one of these; (): no payload and no such column, or those of `conditions`.
        every_payload: all poses are measured under each of `payloads_kg`, in one run a payload: `poses` of each.
        repeats: measurements of each pose (points only).
        setups: number of placements of the scanner that share the poses (points only).
        orientation_sigma_rad: noise about each axis of the jig's orientation at each point; None: no orientations.

    Raises:
        CalibError: an unknown effect, too few poses, or a robot that lacks what the effect needs.

    >>> import calib
    >>> calib.simulate_dataset("rb5", rng=0, effects=["joint_compliance"], poses=40).dataset
    Dataset(simulated: RB5-850, 6 joints; 40 poses (1 reference, 31 train, 8 test); 40 points)
    """
    robot, rng = load_robot(robot), np.random.default_rng(rng)
    if poses < 2:
        raise CalibError(f"found {poses} poses, a dataset needs 2 or more: the reference and one to compare with")
    if not np.isfinite(noise_mm) or noise_mm < 0:
        raise CalibError(f"noise_mm is {noise_mm:g}; a standard deviation is 0 or more")
    check_effects(effects)
    if every_payload and len(payloads_kg) < 2:
        raise CalibError(
            f"found {len(payloads_kg)} payloads; every_payload takes 2 or more, such as payloads_kg=(0, 2.5)"
        )
    if setups < 1 or (setups > 1 and (scans or 4 * setups > poses)):
        raise CalibError(
            f"found {setups} setups for {poses} poses; simulate points, with 4 poses or more for each setup"
        )
    kinds = [SIMULATED[effect_name(effect)] for effect in effects]
    facing = [kind.name for kind in kinds if kind.needs_facing_jig]
    if robot.carries_scanner and facing:
        raise CalibError(
            f"cannot simulate the effect {facing[0]} with a scanner on the flange: no fit takes it there; simulate a "
            "scanner beside the arm"
        )
    robot = ending_at_tool_point(robot)
    if scans and not robot.carries_scanner:
        robot = with_jig(robot, jig)
    base_T_scanner = draw_scanner_pose(robot, rng=rng)
    placed, base_T_jig = base_T_scanner, None
    if scans:
        if robot.carries_scanner:
            placed = draw_flange_mount(rng=rng)
            base_T_jig = draw_jig_in_view(robot, placed, rng=rng, jig=jig)
        candidates = scan_poses(robot, placed, 4 * poses, rng=rng, jig=jig, base_T_jig=base_T_jig)
        q = candidates[spread_poses(np.where(robot.is_revolute, candidates, candidates / 300.0), poses)]
    elif facing:
        q = facing_poses(robot, base_T_scanner, poses, rng=rng)
    else:
        q = random_poses(robot, poses, rng=rng)
    q = rounded(robot, q)
    role = draw_roles(poses, rng=rng) if every_payload else None
    if role is not None:
        again = np.tile(np.where(role == "reference", "train", role), len(payloads_kg) - 1)
        q, role = np.tile(q, (len(payloads_kg), 1)), np.concatenate([role, again])
    poses = len(q)
    if conditions is None:
        conditions = any(kind.needs_conditions for kind in kinds)
    drawn = draw_conditions(robot, poses, rng=rng) if conditions else Conditions()
    drawn = replace(drawn, **{column: None for kind in kinds for column in kind.unrecorded})
    if len(payloads_kg):
        loads_kg = np.asarray(payloads_kg, dtype=float)
        each = len(q) // len(loads_kg)
        drawn = replace(drawn, payload_kg=np.repeat(loads_kg, each) if every_payload else rng.choice(loads_kg, poses))
    if robot.carries_scanner and base_T_jig is None:
        placed, base_T_jig = draw_flange_mount(rng=rng), draw_jig_place(robot, rng=rng)
    scanners = {"": placed}
    if setups > 1:
        scanners = draw_setups(placed, setups, rng=rng)
        drawn = replace(drawn, setup=np.sort(rng.permutation(np.resize(list(scanners), poses))))
    truth = draw_truth(
        robot,
        scanners,
        q,
        base_T_jig=base_T_jig,
        effects=effects,
        tolerances=tolerances,
        conditions=drawn,
        noise_mm=noise_mm,
        visible_sigmas=visible_sigmas,
        rng=rng,
    )
    width = max(2, len(str(poses)))
    ids = tuple(f"p{i + 1:0{width}d}" for i in range(poses))
    table = Poses(
        ids=ids,
        role=draw_roles(poses, rng=rng) if role is None else role,
        q=q,
        setup=np.full(poses, "") if drawn.setup is None else drawn.setup,
        scan_names=tuple(f"{pose_id}.ply" for pose_id in ids),
        payload_kg=drawn.payload_kg,
        temperature_c=drawn.temperature_c,
        time_s=drawn.time_s,
        approach=drawn.approach,
    )
    return measure(
        robot,
        truth,
        table,
        rng=rng,
        name=name,
        description=description,
        jig=jig,
        noise_mm=None if scans else noise_mm,
        scan_model=scan_model if scans else None,
        repeats=repeats,
        orientation_sigma_rad=orientation_sigma_rad,
    )


def draw_roles(count: int, *, rng: np.random.Generator) -> NDArray[np.str_]:
    """Random roles (count,): the first pose is the reference, and 13 in 63 of the other poses are test poses."""
    role = np.full(count, "train", dtype="<U9")
    role[0] = "reference"
    role[1 + rng.permutation(count - 1)[: round((count - 1) * 13 / 63)]] = "test"
    return role


def rounded(robot: Robot, q: Array) -> Array:
    """Joint vectors rounded as a controller would command them: to 0.001 deg, or 0.001 mm."""
    return np.where(robot.is_revolute, np.radians(np.round(np.degrees(q), 3)), np.round(q, 3))
