"""What a dataset knows of its camera: lens, board, the noise of a pixel, and the corners that each image shows.

It stands in [camera] of dataset.toml and in views.csv, which has a row a corner: `pose`, `corner` (its number on the
board), `board_x_mm`, `board_y_mm` (its place on the board, about the board's middle, x to the right and y down the
printed page), `u_px`, `v_px` (in the image, the middle of the first pixel being 0, 0). points.csv holds what follows
from them: the board's pose at each pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array, IndexArray
from calib.brief import Brief
from calib.dataset.dataset import Dataset, Poses
from calib.dataset.files.atomic_write import write_text_atomically
from calib.dataset.files.csv_table import TableFile, short
from calib.dataset.files.folder import inside
from calib.extras.camera.lens import LENS_NAMES, Lens
from calib.extras.camera.view import View
from calib.lazy_modules import pd
from calib.text_files.csv_text import frame_csv
from calib.text_files.toml_table import TomlTable

NAME = "camera"
"""Name of the attachment, and of its table in dataset.toml."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp")
"""Suffixes, in lower case, of the images that are read."""
_VIEWS_FILE = "views.csv"
_COLUMNS = ("board_x_mm", "board_y_mm", "u_px", "v_px")
_IN_PIXELS = 4  # of a lens's numbers
_PIXELS = ("width_px", "height_px", "pixel_sigma_px", *(f"{name}_px" for name in LENS_NAMES[:_IN_PIXELS]))
_LARGEST_PX = 1e6


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

    def files(self, folder: Path, poses: Sequence[str]) -> list[Path]:
        """views.csv and the images of poses in a dataset's folder."""
        images = (self.image_of(pose_id, folder) for pose_id in poses)
        return [folder / _VIEWS_FILE, *(path for path in images if path is not None)]

    def document(self) -> dict[str, Any]:
        """[camera] as a dict for writing; `load_camera` reads it back."""
        lens, numbers = self.lens, dict(zip(LENS_NAMES, self.lens.numbers, strict=True))
        pixels = (lens.width_px, lens.height_px, self.sigma_px, *lens.numbers[:_IN_PIXELS])
        bent = {name: numbers[name] for name in LENS_NAMES[_IN_PIXELS:] if numbers[name] or name in ("k1", "k2")}
        words = {"board": self.board, "lens_from": self.lens_from, "images": self.images}
        return {name: word for name, word in words.items() if word} | dict(zip(_PIXELS, pixels, strict=True)) | bent

    def write(self, folder: Path) -> None:
        """Write views.csv to a dataset's folder."""
        columns = {"pose": self.pose, "corner": self.corner}
        values = np.column_stack([self.board_mm[:, :2], self.pixels])
        columns |= {name: values[:, k] for k, name in enumerate(_COLUMNS)}
        write_text_atomically(folder / _VIEWS_FILE, frame_csv(pd.DataFrame(columns)))

    def _brief(self) -> str:
        return f"{len(set(self.pose))} images of {self.board}, {len(self.corner)} corners, {self.sigma_px:.3f} px"


def load_camera(table: TomlTable, folder: Path, poses: Poses) -> CameraViews | None:
    """What [camera] and views.csv of a dataset's folder say; None where neither is there. Raises DatasetError."""
    if not table.data:
        return None
    named = {name: table.required_number(name) for name in _PIXELS}
    for name, value in named.items():
        if not (abs(value) < _LARGEST_PX and (value > 0.0 or name in ("cx_px", "cy_px"))):
            raise table.error(name, f"found {value:g}", "a number of pixels is needed")
    width, height, sigma_px, *numbers = named.values()
    numbers += [table.number(name, 0.0) or 0.0 for name in LENS_NAMES[_IN_PIXELS:]]
    file = TableFile.load(folder / _VIEWS_FILE)
    file.require(["pose", "corner", *_COLUMNS])
    ids = file.text("pose")
    for row, pose_id in enumerate(ids):
        if pose_id not in poses.ids:
            raise file.error(row, "pose", f"{short(pose_id)} is not in poses.csv", "remove the row or add the pose")
    values = file.numbers(["corner", *_COLUMNS])
    images = table.text("images")
    if images is not None:
        inside(folder, images, table, "images")
    return CameraViews(
        lens=Lens(int(width), int(height), tuple(numbers)),
        board=table.text("board", "") or "",
        sigma_px=sigma_px,
        pose=tuple(ids),
        corner=values[:, 0].astype(np.int64),
        board_mm=np.column_stack([values[:, 1:3], np.zeros(len(values))]),
        pixels=values[:, 3:5],
        lens_from=table.text("lens_from", "") or "",
        images=images,
    )


def camera_of(dataset: Dataset) -> CameraViews | None:
    """What a dataset knows of the images of its camera; None where it has none."""
    found = dataset.attachments.get(NAME)
    return found if isinstance(found, CameraViews) else None


def image_path(dataset: Dataset, pose: int) -> Path | None:
    """Path of the image of a board that a camera took at a pose; None where the dataset keeps none."""
    camera = camera_of(dataset)
    if dataset.folder is None or camera is None:
        return None
    return camera.image_of(dataset.poses.ids[pose], dataset.folder)
