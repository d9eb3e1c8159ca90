"""What a dataset knows of its camera: lens, board, the noise of a pixel, and the corners that each image shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.array_types import Array, IndexArray
from calib.brief import Brief
from calib.camera.lens import Lens
from calib.camera.view import View

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")
"""Suffixes, in lower case, of the images that are read."""


@dataclass(frozen=True)
class CameraViews(Brief):
    """C corners of a board in the images of several poses."""

    lens: Lens
    board: str  # as it was named at the import, "charuco:8x6:30:22"
    sigma_px: float  # of one coordinate of a corner
    pose: tuple[str, ...]  # (C,) id of the pose of each corner
    corner: IndexArray  # (C,) number on the board
    board_mm: Array  # (C, 3) in the board's frame, about the board's middle
    pixels: Array  # (C, 2)
    lens_from: str = ""  # "images", or the name of the file that gave it
    images: str | None = None  # folder of the images below the dataset's, where they are kept

    def of(self, pose_id: str) -> View | None:
        """Corners of one pose; None where its image shows none."""
        rows = np.flatnonzero(np.array(self.pose) == pose_id)
        if not len(rows):
            return None
        return View(pose_id, self.corner[rows], self.board_mm[rows], self.pixels[rows])

    def image_of(self, pose_id: str, folder: Path) -> Path | None:
        """File of the image at a pose, in the dataset's folder; None where it is not kept there."""
        if self.images is None:
            return None
        named = (folder / self.images / f"{pose_id}{suffix}" for suffix in IMAGE_SUFFIXES)
        return next((path for path in named if path.is_file()), None)

    def renamed(self, names: dict[str, str]) -> CameraViews:
        """The views with other names of their poses."""
        return replace(self, pose=tuple(names.get(one, one) for one in self.pose))

    def _brief(self) -> str:
        return f"{len(set(self.pose))} images of {self.board}, {len(self.corner)} corners, {self.sigma_px:.3f} px"
