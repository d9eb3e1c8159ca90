"""A small dataset of scans of balls on an arm's tool, with the truth: rays of `sphere_scene`, an arm with errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.dataset.dataset import Dataset
from calib.dataset.files.folder import write_dataset
from calib.kinematics.chain import nominal_chain
from calib.kinematics.robot import Robot, Target
from calib.scans.scan import Scan, write_scan
from calib.simulation.simulate import simulate_dataset
from tests.support.arms import perturbed
from tests.support.sphere_scene import Ball, scan_of


def places_of(robot: Robot, q: NDArray, offsets: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """(N, 3) in the base frame of points on the last link, the tool's own among them."""
    chain = nominal_chain(robot, q)
    flange = chain.base_T_flange
    out = {name: flange[:, :3, :3] @ xyz + flange[:, :3, 3] for name, xyz in offsets.items()}
    return {"jig": chain.target_mm, **out}


def write_ball_dataset(
    folder: Path,
    toml: str,
    *,
    offsets: Mapping[str, NDArray],
    diameters_mm: Mapping[str, float],
    poses: int = 30,
    rays: int = 4_000,
    seed: int = 0,
    placed_mm: float = 0.5,
) -> dict[str, NDArray]:
    """Write dataset.toml's tables `toml`, an arm with errors, a scan a pose; the true places (N, 3) by target.

    `offsets` are the balls' places on the last link besides "jig"; robot.toml has them to `placed_mm`. The scanner
    turns to the balls at each pose, and all scans are in one frame, as those of a scanner that stands still.
    """
    rng = np.random.default_rng(seed)
    nominal = simulate_dataset(_bare("rb5"), rng=rng, effects=[], poses=poses, noise_mm=0.0).dataset
    true_arm = perturbed(nominal.robot, rng, mm=0.3, rad=0.001)
    base = places_of(true_arm, nominal.poses.q, offsets)
    centre = np.mean([place.mean(axis=0) for place in base.values()], axis=0)
    towards = centre / np.linalg.norm(centre) * [1, 1, 0.2]
    eye = centre + 1200 * towards / np.linalg.norm(towards)
    view = (centre - eye) / np.linalg.norm(centre - eye)
    side = np.cross([0, 0, 1.0], view)
    side /= np.linalg.norm(side)
    scanner_R_base = np.stack([side, np.cross(view, side), view])
    truth = {name: (place - eye) @ scanner_R_base.T for name, place in base.items() if name in diameters_mm}
    (folder / "scans").mkdir(parents=True)
    for i, pose_id in enumerate(nominal.poses.ids):
        balls = [Ball(truth[name][i], diameters_mm[name] / 2) for name in truth]
        middle = np.mean([ball.centre for ball in balls], axis=0)
        scan = _aimed(rng, balls, middle, rays)
        write_scan(folder / "scans" / f"{pose_id}.ply", replace(scan, name=pose_id))
    placed = tuple(Target(name, tuple((xyz + rng.normal(0, placed_mm, 3)).tolist())) for name, xyz in offsets.items())
    dataset: Dataset = replace(
        nominal,
        robot=replace(nominal.robot, targets=placed),
        points=None,
        scan_folder="scans",
        jig_is_declared=False,
        folder=folder,
        scanner=replace(nominal.scanner, scan_sigma_mm=0.02),
        poses=replace(nominal.poses, scan_names=tuple(f"{i}.ply" for i in nominal.poses.ids)),
    )
    write_dataset(dataset, folder)
    with (folder / "dataset.toml").open("a") as file:
        file.write("\n" + toml)
    return truth


def _bare(name: str) -> Robot:
    from calib.dataset.files.robot_toml import builtin_robot

    return builtin_robot(name)


def _aimed(rng: np.random.Generator, balls: list[Ball], middle: NDArray, rays: int) -> Scan:
    """A scan with its field about the middle of the balls, in the scanner's frame: rays are turned there and back."""
    z = middle / np.linalg.norm(middle)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(z, x), z])  # aimed_R_scanner
    seen = scan_of(
        rng,
        [Ball(turn @ ball.centre, ball.radius) for ball in balls],
        [],
        rays=rays,
        field_mm=220.0,
        distance_mm=float(np.linalg.norm(middle)),
    )
    return replace(seen.scan, points_mm=seen.scan.points_mm @ turn)
