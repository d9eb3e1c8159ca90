"""Marker poses as another program would write them, of a simulated camera scene."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.support.camera_scene import Scene


def write_marker_poses(
    scene: Scene, path: Path, rng: np.random.Generator, *, sigma_mm: float, sigma_deg: float, swell: float = 1.0
) -> Path:
    """CSV with the marker's place and quaternion in the camera's frame at each pose, with noise per axis.

    `swell` is the size of the marker that the program was told over the true one.
    """
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["pose", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"])
        for name, at in zip(scene.names, scene.camera_T_board, strict=True):
            off = Rotation.from_rotvec(np.radians(sigma_deg) * rng.normal(size=3))
            turn = (Rotation.from_matrix(at[:3, :3]) * off).as_quat()
            place_mm = swell * at[:3, 3] + sigma_mm * rng.normal(size=3)
            writer.writerow([name, *place_mm.tolist(), *turn.tolist()])
    return path
