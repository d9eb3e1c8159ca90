"""Small datasets of measured points whose arm has an effect that the five-parameter model lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib import calibrate
from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.kinematics.chain import target_jacobian
from calib.simulation.simulate import simulate_dataset

HIDDEN = "transmission_error"
UNNAMED = ("fine_ripple", 3.0)  # of one joint: an effect that no family of the catalogue makes


def write_hidden(folder: Path, name: str = "hidden") -> Path:
    """45 poses of an RB5 at `folder/name`, no scans; the effect is visible at four sigmas."""
    simulation = simulate_dataset(
        "rb5",
        rng=11,
        effects=[(HIDDEN, 4.0)],
        conditions=True,
        poses=45,
        name=name,
    )
    write_dataset(simulation.dataset, folder / name)
    return folder / name


def arm(seed: int, *effects: tuple[str, float], robot: str = "rb5") -> Dataset:
    """64 measured points of an arm with these effects, at so many sigmas."""
    rng = np.random.default_rng(seed)
    simulation = simulate_dataset(robot, rng=rng, effects=effects, poses=64, noise_mm=0.05)
    return simulation.dataset


def with_joint_errors(dataset: Dataset, errors_rad: Mapping[int, Array]) -> Dataset:
    """The dataset with joints, counted from 0, off by (M,) at each point, by the nominal arm's derivative alone."""
    points = dataset.points
    frame = calibrate(dataset).before.scanner_T_base[""]
    by_entry = target_jacobian(dataset.robot, dataset.poses.q[points.pose])
    moved_mm = np.zeros_like(points.xyz_mm)
    for joint, error_rad in errors_rad.items():
        by_theta = by_entry[..., dataset.robot.parameter_names.index(f"theta{joint + 1}")]
        moved_mm += by_theta * error_rad[:, None]
    return dataset.with_points(replace(points, xyz_mm=points.xyz_mm + moved_mm @ frame[:3, :3].T))


def write_unnamed(folder: Path) -> Path:
    """An arm one of whose joints runs unevenly, at `folder/unnamed`."""
    write_dataset(replace(arm(2004, UNNAMED), name="unnamed"), folder / "unnamed")
    return folder / "unnamed"
