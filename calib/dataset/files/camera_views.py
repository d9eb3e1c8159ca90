"""[camera] of dataset.toml and views.csv: lens, board and the corners that each image shows, read, checked and written.

views.csv has a row a corner: `pose`, `corner` (its number on the board), `board_x_mm`, `board_y_mm` (its place on the
board, about the board's middle, x to the right and y down the printed page), `u_px`, `v_px` (in the image, the middle
of the first pixel being 0, 0), and of a bent board `board_z_mm`, behind the printed plane. points.csv holds what
follows from them: the board's pose at each pose.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib.camera.lens import LENS_NAMES, Lens
from calib.camera.observed import CameraViews
from calib.dataset.dataset import Poses
from calib.dataset.files.csv_table import TableFile, short
from calib.lazy_modules import pd
from calib.text_files.csv_text import frame_csv
from calib.text_files.toml_table import TomlTable

VIEWS_FILE = "views.csv"
_COLUMNS = ("board_x_mm", "board_y_mm", "u_px", "v_px")
_HEIGHT = "board_z_mm"
_IN_PIXELS = 4  # of a lens's numbers
_LARGEST_PX = 1e6
_MOST_SIGMA_PX = 1e3


def load_camera(table: TomlTable, path: Path, poses: Poses) -> CameraViews | None:
    """What [camera] and its file of views say; None where neither is there. Raises DatasetError."""
    if not table.data:
        return None
    names = [f"{name}_px" for name in LENS_NAMES[:_IN_PIXELS]]
    numbers = [table.required_number(name) for name in names]
    numbers += [table.number(name, 0.0) or 0.0 for name in LENS_NAMES[_IN_PIXELS:]]
    size = [table.required_number(name) for name in ("width_px", "height_px")]
    for name, value in zip((*names, "width_px", "height_px"), (*numbers, *size), strict=False):
        if not 0.0 < abs(value) < _LARGEST_PX:
            raise table.error(name, f"found {value:g}", "a number of pixels is needed")
    sigma_px = table.required_number("pixel_sigma_px")
    if not 0.0 < sigma_px <= _MOST_SIGMA_PX:
        raise table.error("pixel_sigma_px", f"found {sigma_px:g}", "a standard deviation above 0, in pixels, is needed")
    file = TableFile.load(path)
    file.require(["pose", "corner", *_COLUMNS])
    ids = file.text("pose")
    for row, pose_id in enumerate(ids):
        if pose_id not in poses.ids:
            raise file.error(row, "pose", f"{short(pose_id)} is not in poses.csv", "remove the row or add the pose")
    values = file.numbers(["corner", *_COLUMNS])
    height = file.numbers([_HEIGHT]) if _HEIGHT in file else np.zeros((len(values), 1))
    return CameraViews(
        lens=Lens(int(size[0]), int(size[1]), tuple(map(float, numbers))),
        board=table.text("board", "") or "",
        sigma_px=sigma_px,
        pose=tuple(ids),
        corner=values[:, 0].astype(np.int64),
        board_mm=np.column_stack([values[:, 1:3], height]),
        pixels=values[:, 3:5],
        lens_from=table.text("lens_from", "") or "",
        images=table.text("images"),
    )


def camera_document(camera: CameraViews) -> dict[str, Any]:
    """[camera] as a dict for writing; `load_camera` reads it back."""
    lens = camera.lens
    numbers = dict(zip(LENS_NAMES, lens.numbers, strict=True))
    document: dict[str, Any] = {"board": camera.board, "pixel_sigma_px": camera.sigma_px, "lens_from": camera.lens_from}
    document |= {"width_px": lens.width_px, "height_px": lens.height_px}
    document |= {f"{name}_px": numbers[name] for name in LENS_NAMES[:_IN_PIXELS]}
    document |= {name: numbers[name] for name in LENS_NAMES[_IN_PIXELS:] if numbers[name] or name in ("k1", "k2")}
    if camera.images is not None:
        document["images"] = camera.images
    return {key: value for key, value in document.items() if value != ""}


def views_text(camera: CameraViews) -> str:
    """Text of views.csv."""
    columns = {"pose": camera.pose, "corner": camera.corner}
    values = np.column_stack([camera.board_mm[:, :2], camera.pixels])
    columns |= {name: values[:, k] for k, name in enumerate(_COLUMNS)}
    if np.any(camera.board_mm[:, 2]):
        columns[_HEIGHT] = camera.board_mm[:, 2]
    return frame_csv(pd.DataFrame(columns))
