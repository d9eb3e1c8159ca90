"""Whether a camera's image shows the whole board at a pose of the arm, no more tilted than where it was measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib import frames
from calib.array_types import Array, BoolArray
from calib.dataset.dataset import Dataset
from calib.extras.camera.board_hand_eye import BoardHandEye, board_hand_eye
from calib.extras.camera.lens import Lens, project
from calib.extras.camera.observed import camera_of
from calib.kinematics.chain import nominal_chain

_MARGIN = 0.01  # of the image's width, within which nothing of the board lies
_MORE_TILT_DEG = 5.0  # than at the measured poses
_MOST_REFUSED = 0.2  # of the measured poses: whole boards were then not asked for
_FEWEST = 5


@dataclass(frozen=True, eq=False)
class BoardInImage:
    """A board before a camera, one of them on the flange."""

    lens: Lens
    corners_mm: Array  # (K, 3) in the board's frame
    placed: BoardHandEye
    least_cosine: float = 0.0  # of the tilt against the line of sight

    def cosines(self, base_T_flange: Array) -> Array:
        """Cosines (N,) of the board's tilt against the line of sight; below 0 where its back is seen."""
        at = self.placed.predicted(base_T_flange)
        return np.sum(at[:, :3, 2] * at[:, :3, 3], axis=1) / np.linalg.norm(at[:, :3, 3], axis=1)

    def too_steep(self, base_T_flange: Array) -> BoolArray:
        """(N,) whether the board is more tilted than where it was measured, and a little more."""
        return np.asarray(self.cosines(base_T_flange) < self.least_cosine)

    @property
    def note(self) -> str:
        """Sentence on what the image has to show."""
        tilt_deg = np.degrees(np.arccos(self.least_cosine))
        return (
            f"camera: its image has to show the whole board, tilted by {tilt_deg:.0f}° at most, as it was measured "
            "and a little more"
        )

    def shows_all(self, base_T_flange: Array) -> BoolArray:
        """(N,) whether the whole board is in the image."""
        at = self.placed.predicted(base_T_flange)
        seen_mm = np.einsum("nij,kj->nki", at[:, :3, :3], self.corners_mm) + at[:, None, :3, 3]
        before = np.all(seen_mm[:, :, 2] > 1.0, axis=1)
        pixels = project(self.lens, np.where(before[:, None, None], seen_mm, [0.0, 0.0, 1.0]))
        size, margin = np.array(self.lens.size_px), _MARGIN * self.lens.width_px
        inside = np.all((pixels > margin) & (pixels < size - margin), axis=(1, 2))
        # A polynomial of distortion may bring what lies far beside the image back into it.
        width, height = 0.5 * size / np.array(self.lens.numbers[:2])
        wide = np.linalg.norm(seen_mm[:, :, :2], axis=2) < 1.5 * np.hypot(width, height) * seen_mm[:, :, 2]
        return before & inside & wide.all(axis=1)


def board_in_image(dataset: Dataset, setup: str) -> BoardInImage | None:
    """Board and camera of a dataset as its own table has them; None without images, or where these show parts.

    setup: which placement of the camera.
    """
    camera, points, robot = camera_of(dataset), dataset.points, dataset.robot
    if camera is None or points is None or points.orientations is None:
        return None
    points = points.select(dataset.poses.setup[points.pose] == setup)
    if len(points) < _FEWEST or points.orientations is None:
        return None
    flange = nominal_chain(robot, dataset.poses.q[points.pose]).base_T_flange
    seen = frames.make_transform(points.orientations.scanner_R_jig, points.xyz_mm)
    placed = board_hand_eye(flange, seen, on_flange=robot.carries_scanner)
    found = BoardInImage(camera.lens, np.unique(camera.board_mm, axis=0), placed)
    if np.mean(~found.shows_all(flange)) > _MOST_REFUSED:
        return None
    steepest = float(np.arccos(np.clip(found.cosines(flange).min(), -1.0, 1.0)))
    return replace(found, least_cosine=float(np.cos(min(steepest + np.radians(_MORE_TILT_DEG), np.pi / 2))))
