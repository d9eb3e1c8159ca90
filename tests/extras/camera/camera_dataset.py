"""Datasets of simulated camera views: corners from `camera_scene`, with pixel noise, as an import would make them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from calib.dataset.dataset import Dataset, Poses, Scanner
from calib.dataset.files.robot_toml import load_robot_toml
from calib.extras.camera.board import Board
from calib.extras.camera.detection import Detected, MeasuredViews, measure
from calib.extras.camera.importing.camera_views import CameraPoints
from calib.extras.camera.lens import Lens
from calib.extras.camera.observed import CameraViews
from calib.extras.camera.view import View, covariance_of, shared_errors
from calib.kinematics.cartesian import cartesian_arm, joints_of_poses
from tests.support.camera_scene import DISTORTION, MATRIX, ROBOT_FILE, SIZE_PX, Scene


def true_lens(distortion: Sequence[float] = tuple(DISTORTION)) -> Lens:
    """The lens of the scenes."""
    return Lens(*SIZE_PX, (MATRIX[0, 0], MATRIX[1, 1], MATRIX[0, 2], MATRIX[1, 2], *distortion, 0.0, 0.0, 0.0))


def squared_sigmas(scene: Scene, found: MeasuredViews) -> list[float]:
    """Squared errors of the poses over what is told of them, a degree of freedom."""
    out = []
    for one, shared in zip(found.poses, shared_errors(found.lens, found.poses), strict=True):
        true = scene.camera_T_board[scene.names.index(one.view.pose)]
        turn = cv2.Rodrigues(one.camera_T_board[:3, :3] @ true[:3, :3].T)[0].ravel()
        error = np.concatenate([one.camera_T_board[:3, 3] - true[:3, 3], turn])
        covariance = covariance_of(one, found.sigma_px) + shared @ shared.T
        out.append(float(error @ np.linalg.solve(covariance, error)) / 6.0)
    return out


def simulated_views(
    scene: Scene,
    board: Board,
    rng: np.random.Generator,
    *,
    sigma_px: float,
    lens: Lens | None = None,
    swell: float = 1.0,
) -> MeasuredViews:
    """Board poses of a scene; `swell` is the size of the printed board over what is told of it."""
    views = []
    for k, name in enumerate(scene.names):
        pixels = scene.pixels(k, swell * board.corners_mm)
        seen = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(SIZE_PX)), axis=1))
        if len(seen) >= 8:
            noisy = pixels[seen] + rng.normal(size=(len(seen), 2)) * sigma_px
            views.append(View(name, seen, board.corners_mm[seen], noisy))
    return measure(Detected(board, SIZE_PX, tuple(views), {}, ()), lens)


def simulated_dataset(
    scene: Scene,
    board: Board,
    rng: np.random.Generator,
    *,
    sigma_px: float,
    lens: Lens | None = None,
    swell: float = 1.0,
) -> Dataset:
    """Dataset of a scene, all poses for training; the lens is found from the views where None is given."""
    found = simulated_views(scene, board, rng, sigma_px=sigma_px, lens=lens, swell=swell)
    names = tuple(one.view.pose for one in found.poses)
    views = CameraViews(
        replace(found.lens, covariance=None), board.text, found.sigma_px,
        tuple(one.view.pose for one in found.poses for _ in one.view.corner),
        np.concatenate([one.view.corner for one in found.poses]),
        np.concatenate([one.view.board_mm for one in found.poses]),
        np.concatenate([one.view.pixels for one in found.poses]),
        "images" if lens is None else "lens.yaml",
    )  # fmt: skip
    points = CameraPoints(
        names,
        np.stack([one.camera_T_board for one in found.poses]),
        np.stack([covariance_of(one, found.sigma_px) for one in found.poses]),
        shared_errors(found.lens, found.poses),
        views,
        "flange" if scene.on_flange else "room",
    )
    robot = replace(load_robot_toml(ROBOT_FILE), carries_scanner=scene.on_flange)
    count = len(scene.names)
    role = np.array(["reference", *["train"] * (count - 1)])
    poses = Poses(scene.names, role, scene.q, np.full(count, ""), scene.names)
    return Dataset("simulated", robot, poses, points.points(scene.names), attachments={"camera": views})


def flange_poses_dataset(scene: Scene, rng: np.random.Generator, *, sigma_mm: float, sigma_deg: float) -> Dataset:
    """Dataset of a marker's poses and of the flange's, in place of joints, as the import settles them."""
    seen = scene.camera_T_board.copy()
    seen[:, :3, 3] += sigma_mm * rng.normal(size=(len(seen), 3))
    seen[:, :3, :3] = (
        Rotation.from_rotvec(np.radians(sigma_deg) * rng.normal(size=(len(seen), 3))).as_matrix() @ (seen[:, :3, :3])
    )
    robot, q = cartesian_arm("flange"), joints_of_poses(scene.flanges())
    given = CameraPoints(
        scene.names,
        seen,
        np.zeros((len(seen), 6, 6)),
        np.zeros((len(seen), 6, 0)),
        None,
        "flange" if scene.on_flange else "room",
    )
    points = given.settled(robot, scene.names, q, ())
    role = np.array(["reference", *["train"] * (len(q) - 1)])
    poses = Poses(scene.names, role, q, np.full(len(q), ""), scene.names)
    scanner = Scanner(point_sigma_mm=points.point_sigma_mm, sigmas_estimated=True)
    robot = replace(robot, carries_scanner=scene.on_flange)
    return Dataset("simulated", robot, poses, points.points(scene.names), scanner=scanner)
