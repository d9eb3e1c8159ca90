"""Repeatability: several measurements of one point with the arm at rest (Jang 2025, Table 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from calib.array_types import Array
from calib.dataset.dataset import Dataset, Points
from calib.dataset.stands import SAME_DIGITS, stands_of
from calib.distributions import chi2_sf


@dataclass(frozen=True)
class Repeats:
    """Several measurements of one place. `offset_mm` is None where no reference point is given."""

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
    """All stands of a dataset at which a target was measured more than once (`calib.dataset.stands`)."""
    points, poses = dataset.points, dataset.poses
    if points is None:
        return ()
    return tuple(
        repeats_of(poses.ids[points.pose[rows[0]]], points.xyz_mm[rows]) for rows in _repeated_rows(dataset, points)
    )


def _repeated_rows(dataset: Dataset, points: Points) -> list[list[int]]:
    """The rows of the points that were measured at one stand, for each stand and target with more than one.

    A row that has another's coordinates to the last digit was copied: it is no measurement, and left out.
    """
    stand = stands_of(dataset)
    keys: dict[tuple[int, str], list[int]] = {}
    for row, pose in enumerate(points.pose):
        keys.setdefault((int(stand[pose]), str(points.target[row])), []).append(row)
    different = (_different(points.xyz_mm, rows) for rows in keys.values() if len(rows) > 1)
    return [rows for rows in different if len(rows) > 1]


def _different(xyz_mm: Array, rows: Sequence[int]) -> list[int]:
    """The rows without those whose coordinates an earlier one has."""
    first = np.unique(np.round(xyz_mm[rows], SAME_DIGITS), axis=0, return_index=True)[1]
    return [rows[k] for k in np.sort(first)]


@dataclass(frozen=True)
class ScatterOfRepeats:
    """How far repeats lie apart, against the covariances of the points themselves."""

    ratio: float  # of standard deviations: 1 where the covariances hold what changes from shot to shot
    freedom: int
    chance: float  # that covariances which hold it show as large a ratio


def scatter_against_covariances(dataset: Dataset) -> ScatterOfRepeats | None:
    """The repeats of a dataset held against its points' covariances C; None without covariances or repeats.

    At each stand sum (x_i - m) . C_i^-1 (x_i - m) about the weighted mean m is chi-squared of 3 (n - 1) degrees of
    freedom where the covariances are honest. Errors that are alike in all shots of a stand are in no repeat.
    """
    points = dataset.points
    if points is None or points.covariance_mm2 is None:
        return None
    squared, freedom = 0.0, 0
    for rows in _repeated_rows(dataset, points):
        xyz, covariance = points.xyz_mm[rows], points.covariance_mm2[rows]
        if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance).min() <= 0:
            continue
        weight = np.linalg.inv(covariance)
        mean = np.linalg.solve(weight.sum(axis=0), np.einsum("nij,nj->i", weight, xyz))
        squared += float(np.einsum("ni,nij,nj->", xyz - mean, weight, xyz - mean))
        freedom += 3 * (len(rows) - 1)
    if not freedom:
        return None
    return ScatterOfRepeats(float(np.sqrt(squared / freedom)), freedom, chi2_sf(squared, freedom))


def pooled_sigma_mm(repeats: Sequence[Repeats]) -> float:
    """Standard deviation of one coordinate, pooled over all places: sqrt(sum (n_i - 1) s_i^2 / sum 3 (n_i - 1))."""
    freedom = sum(3 * (r.count - 1) for r in repeats)
    return float(np.sqrt(sum((r.count - 1) * float(r.sigma_mm @ r.sigma_mm) for r in repeats) / freedom))


def repeats_frame(repeats: Sequence[Repeats]) -> pd.DataFrame:
    """The columns of Jang's Table 1, one row a place."""
    return pd.DataFrame(
        {
            "place": [r.label for r in repeats],
            "measured": [r.count for r in repeats],
            **{f"sigma_{axis}_mm": [float(r.sigma_mm[k]) for r in repeats] for k, axis in enumerate("xyz")},
            "position_error_mm": [float("nan") if r.offset_mm is None else r.offset_mm for r in repeats],
        }
    )
