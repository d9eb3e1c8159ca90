"""The same dataset with other measured points, or with other columns of its poses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from calib.array_types import Array
from calib.dataset.dataset import Dataset


def with_xyz(dataset: Dataset, xyz_mm: Array) -> Dataset:
    """The dataset with its points elsewhere."""
    return dataset.with_points(replace(dataset.points, xyz_mm=xyz_mm))


def with_poses(dataset: Dataset, **columns: Any) -> Dataset:
    """The dataset with other joints, roles or conditions."""
    return replace(dataset, poses=replace(dataset.poses, **columns))
