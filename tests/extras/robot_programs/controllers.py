"""Poses in the numbers of robots' makers, and a controller that finds joints for them, in numpy and SciPy alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

LANGUAGES = {"URScript": ".script", "KRL": ".src", "RAPID": ".mod"}
NUMBER = r"[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?"


def transform(rotation: Rotation, position: object) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), position
    return out


def inverse(flange: Callable[[np.ndarray], np.ndarray], goal: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Joints near a start with which an arm's flange stands at a goal, as a controller finds them."""

    def off(q: np.ndarray) -> np.ndarray:
        at = flange(q)
        return np.r_[at[:3, 3] - goal[:3, 3], 1000.0 * (at[:3, :3] - goal[:3, :3]).ravel()]

    found = least_squares(off, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.abs(off(found.x)).max() < 1e-6
    return found.x


def makers(language: str, pose: np.ndarray) -> np.ndarray:
    """Numbers of a pose in the maker's convention."""
    turn, position = Rotation.from_matrix(pose[:3, :3]), pose[:3, 3]
    if language == "URScript":
        return np.r_[position / 1000.0, turn.as_rotvec()]
    if language == "KRL":
        return np.r_[position, turn.as_euler("ZYX", degrees=True)]
    x, y, z, w = turn.as_quat()
    return np.r_[position, w, x, y, z]


def of_maker(language: str, values: np.ndarray) -> np.ndarray:
    position, turn = values[:3], values[3:]
    if language == "URScript":
        return transform(Rotation.from_rotvec(turn), 1000.0 * position)
    if language == "KRL":
        return transform(Rotation.from_euler("ZYX", turn, degrees=True), position)
    return transform(Rotation.from_quat([*turn[1:], turn[0]]), position)


def listed(language: str, values: np.ndarray, decimals: int = 9) -> str:
    texts = [f"{value:.{decimals}f}" for value in values]
    if language == "KRL":
        return ",".join(f"{name} {text}" for name, text in zip("XYZABC", texts, strict=True))
    if language == "RAPID":
        return f"[{','.join(texts[:3])}],[{','.join(texts[3:])}]"
    return f"p[{', '.join(texts)}]"
