"""Measurement of a simulated arm: points or scans as a dataset, with the truth; and both as files."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array_types import Array
from calib.brief import Brief
from calib.dataset.dataset import Dataset, Orientations, Points, Poses, Scanner
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.folder import write_dataset
from calib.errors import CalibError
from calib.jig import Jig
from calib.kinematics.robot import Robot
from calib.progress import OnProgress, counted
from calib.scans.scan import write_scan
from calib.simulation.scanner import ScanModel, SimulatedScan, simulate_scan
from calib.simulation.scene import CUBE_CORNER
from calib.simulation.truth.equilibrium import Truth, scanner_T_target, truth_document
from calib.simulation.truth.mechanism import Conditions
from calib.simulation.truth.visibility import SimulatedCell
from calib.workcell.jig_on_tool import JIG_HEIGHT_MM, target_T_jig

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
