"""Lenses from files: ROS's camera_info (YAML file or message), OpenCV's FileStorage (YAML, XML, JSON), plain JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.extras.camera.importing.documents import SUFFIXES, by_lower_name, documents, number_array
from calib.extras.camera.lens import LENS_NAMES, Lens

_MATRIX = ("camera_matrix", "cameramatrix", "k", "mtx", "intrinsic_matrix", "intrinsics", "camera_intrinsic")
_DISTORTION = (
    "distortion_coefficients", "dist_coeffs", "distcoeffs", "distortion_coeffs", "distortion", "dist_coeff", "dist",
    "d",
)  # fmt: skip
_SIZE = ("image_size", "resolution", "img_size")
_MODELS = ("plumb_bob", "rational_polynomial", "brown_conrady", "pinhole", "opencv", "radtan", "none", "")


def load_lens(path: Path) -> Lens:
    """Lens of a file. Raises CalibError."""
    if path.suffix.lower() not in SUFFIXES:
        raise CalibError(f"--intrinsics {path}: {' '.join(SUFFIXES)} can be read")
    keys = by_lower_name(next(iter(documents(path)), None))
    model = str(keys.get("distortion_model", "")).lower()
    if model not in _MODELS:
        raise CalibError(
            f"{path}: distortion_model {model!r}: lenses of a pinhole with plumb_bob or rational_polynomial can be "
            "read; rectify the images, or calibrate them with one of these"
        )
    matrix = _numbers(keys, _MATRIX, LENS_NAMES[:4])
    distortion = _numbers(keys, _DISTORTION, LENS_NAMES[4:6])
    size = _numbers(keys, _SIZE, ("image_width", "image_height"))
    size = _numbers(keys, (), ("width", "height")) if size is None else size
    if matrix is None or len(matrix) not in (4, 9):
        raise CalibError(f"{path}: holds no camera matrix ({', '.join(_MATRIX[:4])}, or fx, fy, cx, cy)")
    if distortion is None or np.any(distortion[8:]):
        raise CalibError(
            f"{path}: holds no distortion coefficients k1 k2 p1 p2 k3 k4 k5 k6 ({', '.join(_DISTORTION[:3])}); give [] "
            "for a lens that has none"
        )
    if size is None or len(size) != 2:
        raise CalibError(f"{path}: has no image_width and image_height, in pixels; add them")
    numbers = np.zeros(len(LENS_NAMES))
    numbers[:4] = matrix[[0, 4, 2, 5]] if len(matrix) == 9 else matrix  # of four in Kalibr's order: fu, fv, pu, pv
    numbers[4 : 4 + len(distortion[:8])] = distortion[:8]
    for k, name in enumerate(LENS_NAMES[6:], 6):
        numbers[k] = keys[name] if isinstance(keys.get(name), int | float) else numbers[k]
    (width, height), (fx, fy, cx, cy) = size.astype(int).tolist(), numbers[:4]
    if not (0.1 * width < fx < 100 * width and 0.1 * width < fy < 100 * width and 0 < cx < width and 0 < cy < height):
        raise CalibError(
            f"{path}: fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g} are no lens of {width} x {height} pixels; give the "
            "camera matrix in pixels, of this resolution"
        )
    return Lens(width, height, tuple(map(float, numbers)))


def _numbers(keys: dict[str, Any], names: Sequence[str], each: Sequence[str]) -> Array | None:
    """Numbers of the first of some entries that is there, or those of entries of their own; None where none is.

    An entry that is empty, null or a single 0 holds none, (0,): no distortion.
    """
    if all(name in keys for name in each):
        return number_array([keys[name] for name in each])
    value = next((keys[name] for name in names if name in keys), [None])
    data = value.get("data", value) if isinstance(value, dict) else value
    return number_array(data) if data else np.zeros(0)
