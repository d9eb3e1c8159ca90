"""Whole datasets with known truth: an arm with link errors and effects, its poses, its points or scans.

The arm's errors are drawn in `calib.simulation.truth.arm_sampling`, its poses in `calib.simulation.pose_design`, what
surrounds it in `calib.simulation.conditions`; what it then does is worked out in
`calib.simulation.truth.equilibrium`, and what the scanner makes of it in `calib.simulation.scanner`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.dataset.dataset import Dataset, Orientations, Points, Poses, Scanner
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.folder import write_dataset
from calib.errors import CalibError
from calib.jig import Jig, jig_geometry
from calib.kinematics.robot import Robot
from calib.scans.scan import write_scan
from calib.simulation.conditions import draw_conditions
from calib.simulation.pose_design import (
    facing_poses,
    more_places,
    place_scanner,
    random_poses,
    scan_poses,
    spread_poses,
    target_T_jig,
)
from calib.simulation.scanner import (
    CUBE_CORNER,
    PLAIN_MODEL,
    ScanModel,
    SimulatedScan,
    simulate_scan,
)
from calib.simulation.truth.arm_sampling import (
    NEED_CONDITIONS,
    NEED_FACING,
    TYPICAL,
    Tolerances,
    Wanted,
    check_effects,
    draw_truth,
    effect_name,
)
from calib.simulation.truth.equilibrium import Truth, scanner_T_target, truth_document
from calib.simulation.truth.mechanism import Conditions
from calib.simulation.truth.visibility import Cell

JIG_HEIGHT_MM = 88.0
"""From the flange to the jig's apex, Jang's Table 2; taken where a robot's tool row has no length of its own."""

_WINDOW_RASTER_MM = 30.0


@dataclass(frozen=True)
class Simulation:
    """A dataset and the truth it was made from. Scans are cast when asked for, each from its own seed."""

    dataset: Dataset
    truth: Truth
    apex_mm: Array  # (N, 3) where the scanner has the measured point, noise apart
    scanner_T_jig: Array  # (N, 4, 4)
    scan_model: ScanModel | None
    scan_seeds: tuple[int, ...]

    def scan(self, pose: int) -> SimulatedScan:
        """Cast the scan of one pose: the same points every time."""
        if self.scan_model is None:
            raise CalibError(
                f"dataset {self.dataset.name}: simulated as points; ask for scans when simulating"
            )
        # The window snaps to a raster over the field, so that repeats of a pose share it.
        apex_mm = self.apex_mm[pose, :2]
        offset_mm = _WINDOW_RASTER_MM * np.round(apex_mm / _WINDOW_RASTER_MM) - apex_mm
        return simulate_scan(
            self.scanner_T_jig[pose],
            self.dataset.jig,
            rng=np.random.default_rng(self.scan_seeds[pose]),
            name=self.dataset.poses.ids[pose],
            model=self.scan_model,
            flange_mm=abs(self.dataset.robot.tool.d_mm),
            arm_turn_rad=float(-self.dataset.poses.q[pose, -1]),
            window_offset_mm=(float(offset_mm[0]), float(offset_mm[1])),
        )

    def document(self) -> dict[str, Any]:
        """What truth.json holds."""
        poses = self.dataset.poses
        cell = Cell(self.dataset.robot, self.truth.with_effects(), poses.q, Conditions.of(poses))
        visible = {
            cause.name: cell.visible_rms_mm(cause) for cause in self.truth.causes if not cause.is_absent
        }
        return truth_document(
            self.truth,
            self.dataset.robot,
            visible_rms_mm=visible,
            dataset=self.dataset.name,
            apex_mm=dict(zip(poses.ids, self.apex_mm.tolist(), strict=True)),
        )


def simulate_dataset(
    robot: Robot,
    *,
    rng: np.random.Generator,
    effects: Sequence[Wanted] = (),
    visible_sigmas: float | None = None,
    conditions: bool | None = None,
    poses: int = 64,
    noise_mm: float = 0.05,
    scans: bool = False,
    name: str = "simulated",
    description: str = "",
    jig: Jig = CUBE_CORNER,
    tolerances: Tolerances = TYPICAL,
    scan_model: ScanModel = PLAIN_MODEL,
    payloads_kg: Sequence[float] = (),
    repeats: int = 1,
    setups: int = 1,
    orientation_sigma_rad: float | None = None,
) -> Simulation:
    """Simulate a calibration of `robot`, which stays the nominal arm of the dataset.

    Args:
        effects: what the true arm carries, by name (`SIMULATED_EFFECTS`, `OUTSIDE_EFFECTS`), as (name, visible size in
            noise sigmas), or with all parameters; what is not given is drawn.
        visible_sigmas: the visible size of effects given by name alone; None lets each move the point by 0.2 to 0.5 mm.
        conditions: payload, temperature, time and approach vary and are written down. None: where an effect needs it.
        poses: how many; one is the reference, the others are shared 50 : 13 between train and test (Jang 2025).
        noise_mm: of a measured point, each axis; scans make their own from `scan_model`.
        scans: poses hold the jig in the scanner's field and scans are cast. Otherwise points over the work space.
        payloads_kg: each pose carries one of these; () for none and no such column, or as `conditions` has it.
        repeats: measurements of each pose (points only).
        setups: how many placements of the scanner share the poses (points only).
        orientation_sigma_rad: noise about each axis of the jig's orientation, measured with each point; None: points.

    Raises:
        CalibError: an unknown effect, too few poses, or a robot that lacks what the effect needs.
    """
    if poses < 2:
        raise CalibError(
            f"found {poses} poses, a dataset needs 2 or more: the reference and one to compare with"
        )
    if not np.isfinite(noise_mm) or noise_mm < 0:
        raise CalibError(f"noise_mm is {noise_mm:g}; a standard deviation is 0 or more")
    check_effects(effects)
    if setups < 1 or (setups > 1 and (scans or 4 * setups > poses)):
        raise CalibError(
            f"found {setups} setups for {poses} poses; simulate points, with 4 poses or more for each setup"
        )
    if scans:
        robot = with_jig(robot, jig)
    base_T_scanner = place_scanner(robot, rng=rng)
    if scans:
        candidates = scan_poses(robot, base_T_scanner, 4 * poses, rng=rng, jig=jig)
        q = candidates[spread_poses(np.where(robot.is_revolute, candidates, candidates / 300.0), poses)]
    else:
        faced = any(effect_name(effect) in NEED_FACING for effect in effects)
        q = (
            facing_poses(robot, base_T_scanner, poses, rng=rng)
            if faced
            else random_poses(robot, poses, rng=rng)
        )
    q = rounded(robot, q)
    if conditions is None:
        conditions = any(effect_name(effect) in NEED_CONDITIONS for effect in effects)
    around = draw_conditions(robot, poses, rng=rng) if conditions else Conditions()
    if len(payloads_kg):
        around = replace(around, payload_kg=rng.choice(np.asarray(payloads_kg, float), poses))
    scanners = {"": base_T_scanner}
    if setups > 1:
        scanners = more_places(base_T_scanner, setups, rng=rng)
        around = replace(around, setup=np.sort(rng.permutation(np.resize(list(scanners), poses))))
    truth = draw_truth(
        robot,
        scanners,
        q,
        effects=effects,
        tolerances=tolerances,
        conditions=around,
        noise_mm=noise_mm,
        visible_sigmas=visible_sigmas,
        rng=rng,
    )
    width = max(2, len(str(poses)))
    ids = tuple(f"p{i + 1:0{width}d}" for i in range(poses))
    table = Poses(
        ids=ids,
        role=draw_roles(poses, rng=rng),
        q=q,
        setup=np.full(poses, "") if around.setup is None else around.setup,
        scan_names=tuple(f"{pose_id}.ply" for pose_id in ids),
        payload_kg=around.payload_kg,
        temperature_c=around.temperature_c,
        time_s=around.time_s,
        approach=around.approach,
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
    """Measure given poses of a given arm: points where `noise_mm` is given, scans where `scan_model` is.

    The points are full poses of the jig where `orientation_sigma_rad` is given.
    """
    scanner_T_tool = scanner_T_target(truth, poses.q, Conditions.of(poses))
    apex_mm = scanner_T_tool[:, :3, 3]
    points = None
    if noise_mm is not None:
        pose = np.repeat(np.arange(len(poses)), repeats)
        noisy_mm = apex_mm[pose] + noise_mm * rng.standard_normal((len(pose), 3))
        points = Points(pose=pose, xyz_mm=noisy_mm, target=np.full(len(pose), "jig"))
        if orientation_sigma_rad is not None:
            turned = Rotation.from_rotvec(orientation_sigma_rad * rng.standard_normal((len(pose), 3)))
            scanner_R_jig = (scanner_T_tool @ target_T_jig(robot))[pose, :3, :3]
            orientations = Orientations((turned * Rotation.from_matrix(scanner_R_jig)).as_matrix())
            points = replace(points, orientations=orientations)
    dataset = Dataset(
        name=name,
        description=description,
        robot=robot,
        poses=poses,
        points=points,
        scan_folder=None if scan_model is None else "scans",
        scanner=Scanner(
            point_sigma_mm=noise_mm or None,
            scan_sigma_mm=None if scan_model is None else scan_model.scan_sigma_mm,
            orientation_sigma_rad=orientation_sigma_rad or None,
        ),
        jig=jig,
    )
    seeds = (
        tuple(int(seed) for seed in rng.integers(2**63, size=len(poses))) if scan_model is not None else ()
    )
    return Simulation(dataset, truth, apex_mm, scanner_T_tool @ target_T_jig(robot), scan_model, seeds)


def write_simulation(
    simulation: Simulation,
    folder: Path,
    *,
    truth_path: Path | None = None,
    on_progress: Callable[[int, int, str], None] | None = None,
) -> None:
    """Write the dataset's folder, its scans, and the truth (truth.json in the folder unless told otherwise)."""
    folder = Path(folder)
    poses = simulation.dataset.poses
    if simulation.scan_model is not None:
        scan_folder = folder / (simulation.dataset.scan_folder or "scans")
        scan_folder.mkdir(parents=True, exist_ok=True)
        for i, scan_name in enumerate(poses.scan_names):
            write_scan(scan_folder / scan_name, simulation.scan(i).scan)
            if on_progress is not None:
                on_progress(i + 1, len(poses), poses.ids[i])
    write_dataset(simulation.dataset, folder)
    truth_path = folder / "truth.json" if truth_path is None else truth_path
    truth_path.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomically(truth_path, json.dumps(simulation.document(), indent=1) + "\n")


def with_jig(robot: Robot, jig: Jig) -> Robot:
    """The robot with a tool row that reaches from the flange to a jig's apex, where it has none."""
    if abs(robot.tool.d_mm) > float(np.abs(jig_geometry(jig)[0][:, 2]).mean()) + 1.0:
        return robot
    return replace(robot, tool=replace(robot.tool, d_mm=JIG_HEIGHT_MM))


def draw_roles(count: int, *, rng: np.random.Generator) -> NDArray[np.str_]:
    """(count,) the first pose is the reference; of the others 13 in 63 are for testing, drawn at random."""
    role = np.full(count, "train", dtype="<U9")
    role[0] = "reference"
    role[1 + rng.permutation(count - 1)[: round((count - 1) * 13 / 63)]] = "test"
    return role


def rounded(robot: Robot, q: Array) -> Array:
    """Joint vectors as a controller would command them: whole thousandths of a degree, or of a millimetre."""
    return np.where(robot.is_revolute, np.radians(np.round(np.degrees(q), 3)), np.round(q, 3))
