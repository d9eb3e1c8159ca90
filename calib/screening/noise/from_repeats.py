"""Repeated measurements of one place as a residual: what they scatter is noise, whatever the arm does."""

from __future__ import annotations

import numpy as np

from calib.array_types import Array
from calib.dataset.dataset import Dataset
from calib.dataset.repeats import repeat_groups
from calib.fitting.noise import Moments
from calib.fitting.observations import Observations
from calib.fitting.scanner_frame import whitener
from calib.screening.noise.likelihood import LinearResidual

ENOUGH = 24  # further repeats: as many tell the shape, and where they show none there is none


def scatter_of_repeats(dataset: Dataset) -> LinearResidual | None:
    """The scatter of each place's repeats about their mean, as k - 1 independent differences of k repeats.

    None with fewer than `ENOUGH` differences. Rows that were written twice tell nothing and are left out.
    """
    points = dataset.points
    if points is None:
        return None
    target = np.unique(points.target, return_inverse=True)[1]
    key = np.column_stack([repeat_groups(dataset)[points.pose], target])
    place = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
    if len(points) - len(np.unique(place)) < ENOUGH:
        return None
    observed = Observations.of(dataset, np.ones(len(dataset.poses), dtype=bool))
    covariance = observed.covariance_mm2 * (1.0 if points.counts_as is None else points.counts_as[:, None, None])
    differences: list[Array] = []
    rows: list[int] = []
    for repeats in np.split(np.argsort(place, kind="stable"), np.cumsum(np.bincount(place))[:-1]):
        xyz_mm, first = np.unique(np.round(points.xyz_mm[repeats], 9), axis=0, return_index=True)
        if len(xyz_mm) > 1:
            differences.append(_contrasts(len(xyz_mm)) @ points.xyz_mm[repeats[np.sort(first)]])
            rows += repeats[: len(xyz_mm) - 1].tolist()
    if len(rows) < ENOUGH:
        return None
    whiten = whitener(covariance[rows])
    residual = np.einsum("mij,mj->mi", whiten, np.concatenate(differences))
    moments = Moments.of(dataset.poses, points.pose[rows])
    return LinearResidual(points.xyz_mm[rows], whiten, residual[:, :, None], moments)


def _contrasts(count: int) -> Array:
    """(count - 1, count) orthonormal rows, each a difference of values (Helmert)."""
    full = np.linalg.qr(np.column_stack([np.ones(count), np.eye(count)[:, 1:]]))[0]
    return np.asarray(full[:, 1:].T)
