"""How well a standing point is found again and again: the experiment of Jang 2025, Table 1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.dataset.dataset import Dataset


@dataclass(frozen=True)
class Repeats:
    """Several measurements of one place. `offset_mm` is None without a reference to hold the mean against."""

    label: str
    count: int
    mean_mm: Array  # (3,)
    sigma_mm: Array  # (3,) sample standard deviation of each axis
    offset_mm: float | None  # length of mean minus reference: Jang's position error


def repeats_of(label: str, xyz_mm: ArrayLike, reference_mm: ArrayLike | None = None) -> Repeats:
    """Mean, deviation and position error of measurements (R, 3) of one place."""
    xyz = np.asarray(xyz_mm, dtype=float)
    mean = xyz.mean(axis=0)
    offset = None if reference_mm is None else float(np.linalg.norm(mean - np.asarray(reference_mm)))
    return Repeats(label, len(xyz), mean, xyz.std(axis=0, ddof=1), offset)


def find_repeats(dataset: Dataset) -> tuple[Repeats, ...]:
    """All joint vectors of a dataset at which a target was measured more than once in one setup."""
    points, poses = dataset.points, dataset.poses
    if points is None:
        return ()
    keys: dict[tuple[bytes, str, str], list[int]] = {}
    for row, pose in enumerate(points.pose):
        key = (np.round(poses.q[pose], 9).tobytes(), str(poses.setup[pose]), str(points.target[row]))
        keys.setdefault(key, []).append(row)
    return tuple(
        repeats_of(poses.ids[points.pose[rows[0]]], points.xyz_mm[rows])
        for rows in keys.values()
        if len(rows) > 1
    )


def pooled_sigma_mm(repeats: Sequence[Repeats]) -> float:
    """One coordinate's standard deviation over all places, by degrees of freedom."""
    freedom = sum(3 * (r.count - 1) for r in repeats)
    return float(np.sqrt(sum((r.count - 1) * float(r.sigma_mm @ r.sigma_mm) for r in repeats) / freedom))


def repeats_frame(repeats: Sequence[Repeats]) -> pd.DataFrame:
    """As Table 1 prints it: a row a place."""
    return pd.DataFrame(
        {
            "place": [r.label for r in repeats],
            "measured": [r.count for r in repeats],
            **{f"sigma_{axis}_mm": [float(r.sigma_mm[k]) for r in repeats] for k, axis in enumerate("xyz")},
            "position_error_mm": [float("nan") if r.offset_mm is None else r.offset_mm for r in repeats],
        }
    )
