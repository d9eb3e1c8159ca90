"""Lenses from files: ROS's camera_info (YAML file or message), OpenCV's FileStorage (YAML, XML, JSON), plain JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calib.array_types import Array
from calib.errors import CalibError
from calib.extras.camera.importing.documents import SUFFIXES, documents, number_array
from calib.extras.camera.lens import LENS_NAMES, Lens

_MATRIX = ("camera_matrix", "cameramatrix", "k", "mtx", "intrinsic_matrix", "intrinsics", "camera_intrinsic")
_DISTORTION = (
    "distortion_coefficients", "dist_coeffs", "distcoeffs", "distortion_coeffs", "distortion", "dist_coeff", "dist",
    "d",
)  # fmt: skip
_WIDTH, _HEIGHT = ("image_width", "width"), ("image_height", "height")
_MODELS = ("plumb_bob", "rational_polynomial", "brown_conrady", "pinhole", "opencv", "radtan", "none", "")


def load_lens(path: Path) -> Lens:
    """Lens of a file. Raises CalibError."""
    if path.suffix.lower() not in SUFFIXES:
        raise CalibError(f"--intrinsics {path}: {' '.join(SUFFIXES)} can be read")
    found = documents(path)
    if not found or not isinstance(found[0], dict):
        raise CalibError(f"{path}: holds no lens; a camera matrix and distortion coefficients are needed")
    keys = {str(key).lower().replace(" ", "_"): value for key, value in found[0].items()}
    model = str(keys.get("distortion_model", "")).lower()
    if model not in _MODELS:
        raise CalibError(
            f"{path}: distortion_model {model!r}: lenses of a pinhole with plumb_bob or rational_polynomial can be "
            "read; rectify the images, or calibrate them with one of these"
        )
    numbers = np.zeros(len(LENS_NAMES))
    numbers[:4] = _matrix(path, keys)
    distortion = _distortion(path, keys)
    numbers[4 : 4 + len(distortion)] = distortion
    width, height = _size(keys) or (0, 0)
    if width < 1 or height < 1:
        raise CalibError(f"{path}: has no image_width and image_height, in pixels; add them")
    fx, fy, cx, cy = numbers[:4]
    if not (0.1 * width < fx < 100 * width and 0.1 * width < fy < 100 * width and 0 < cx < width and 0 < cy < height):
        raise CalibError(
            f"{path}: fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g} are no lens of {width} x {height} pixels; give the "
            "camera matrix in pixels, of this resolution"
        )
    return Lens(int(width), int(height), tuple(map(float, numbers)))


def _matrix(path: Path, keys: dict[str, Any]) -> Array:
    """fx, fy, cx, cy (4,) from a camera matrix, or from keys of their own."""
    if all(name in keys for name in ("fx", "fy", "cx", "cy")):
        four = number_array([keys[name] for name in ("fx", "fy", "cx", "cy")])
        if four is not None:
            return four
    for name in _MATRIX:
        value = number_array(keys.get(name))
        if value is not None and len(value) == 9:
            return value[[0, 4, 2, 5]]
        if value is not None and len(value) == 4:
            return value  # Kalibr's order: fu, fv, pu, pv
    raise CalibError(f"{path}: holds no camera matrix ({', '.join(_MATRIX[:4])}, or fx, fy, cx, cy)")


def _distortion(path: Path, keys: dict[str, Any]) -> Array:
    named = [keys.get(name, 0.0) for name in LENS_NAMES[4:]]
    for name in _DISTORTION:
        if name in keys:
            value = keys[name].get("data") if isinstance(keys[name], dict) else keys[name]
            found = number_array(value) if value else np.zeros(0)  # none, an empty matrix or a single 0: no distortion
            if found is None or (len(found) > 8 and np.any(found[8:])):
                raise CalibError(f"{path}: {name}: up to 8 numbers are needed, k1 k2 p1 p2 k3 k4 k5 k6")
            return found[:8]
    if all(isinstance(one, int | float) for one in named) and any(name in keys for name in LENS_NAMES[4:]):
        return np.array(named, dtype=float)
    raise CalibError(
        f"{path}: holds no distortion coefficients ({', '.join(_DISTORTION[:3])}); give [] for a lens that has none"
    )


def _size(keys: dict[str, Any]) -> tuple[int, int] | None:
    for name in ("image_size", "resolution", "img_size"):
        value = number_array(keys.get(name))
        if value is not None and len(value) == 2:
            return int(value[0]), int(value[1])
    width = next((keys[name] for name in _WIDTH if isinstance(keys.get(name), int | float)), None)
    height = next((keys[name] for name in _HEIGHT if isinstance(keys.get(name), int | float)), None)
    return None if width is None or height is None else (int(width), int(height))
